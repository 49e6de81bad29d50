"""The C-MPSP iteration: one state machine for problems in Python and in compiled code."""
