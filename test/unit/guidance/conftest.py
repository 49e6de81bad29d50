"""Puts the helpers of these tests, and of the method's, where tests can import them."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / 'mpsp')]
