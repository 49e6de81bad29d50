"""What no command leaves without."""
