"""Where to drive to, and when to be there."""
