"""`python -m pushgraph` is the command `pushgraph`."""

from pushgraph.cli import main

main()
