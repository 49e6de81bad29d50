"""What the law predicts before it plans: pending commands, slip, moving obstacles."""
