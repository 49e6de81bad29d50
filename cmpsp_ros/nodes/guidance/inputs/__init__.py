"""What the guidance node receives."""
