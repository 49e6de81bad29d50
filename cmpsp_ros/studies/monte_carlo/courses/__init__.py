"""What is random in a run: its start, its course and its obstacles."""
