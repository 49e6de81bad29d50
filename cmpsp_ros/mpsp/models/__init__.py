"""Problems from functions and CasADi expressions, wrappers, and a check of derivatives."""
