"""What will happen whatever is decided now."""
