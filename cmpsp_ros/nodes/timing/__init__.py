"""What keeps control steps on time: compilers, garbage, scheduling, messages that wait."""
