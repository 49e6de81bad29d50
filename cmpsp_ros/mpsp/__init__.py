"""The C-MPSP method for any problem of the form (1)-(6): arrays in, arrays out."""
