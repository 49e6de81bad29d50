"""Where a robot may be: roads, obstacles, free space, and the margin between samples."""
