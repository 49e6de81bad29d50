"""The recorder: topics of the graph into one bag."""
