"""What the nodes share: their life, topics, parameters and health."""
