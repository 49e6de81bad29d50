"""What the guidance node publishes."""
