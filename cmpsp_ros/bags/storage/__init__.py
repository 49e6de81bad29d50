"""The files of a bag: writing them, checking them before they are read, and recovery.

Checks raise a `ReaderError`: a file is damaged, cut off, or beyond the limits.
"""
