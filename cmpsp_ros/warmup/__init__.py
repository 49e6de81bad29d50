"""Compiles what nodes and commands run, before they do, and tells how fast a computer is."""
