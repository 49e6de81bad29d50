"""The player: publishes a bag to live nodes."""
