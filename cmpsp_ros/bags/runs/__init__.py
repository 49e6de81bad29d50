"""A recorded run as arrays: decisions, goals, moving obstacles and what they came near."""
