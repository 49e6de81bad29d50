"""The player: a bag to live nodes."""
