"""Problems of the field, each solved beside IPOPT: ``python -m examples`` writes the table."""
