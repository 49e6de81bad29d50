"""Lets these tests use the judge of derivatives that the method's own tests use."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / 'mpsp'))
sys.path.insert(0, str(Path(__file__).parent))
