"""On which side each obstacle is passed, on a road between two circles."""
