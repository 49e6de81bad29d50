"""The files of a bag: writing them, checking them before they are read, and recovery."""
