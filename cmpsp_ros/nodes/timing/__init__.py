"""Keeping control steps on time: compilation, garbage collection, scheduling, queues."""
