"""One run from start to pictures: the nodes as processes, watched, recorded and summed up."""
