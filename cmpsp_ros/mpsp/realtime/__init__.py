"""The C-MPSP iteration compiled whole, for problems whose functions are compiled as well."""
