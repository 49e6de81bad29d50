"""One module for each family of the paper's figures and tables."""
