"""One run, from parameters to pictures: the nodes as processes, monitored, recorded, summarised."""
