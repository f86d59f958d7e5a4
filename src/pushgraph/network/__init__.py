"""The networks: from the graph of a frame to the motion of every body in it."""
