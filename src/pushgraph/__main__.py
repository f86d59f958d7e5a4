"""`python -m pushgraph` is the command `pushgraph`."""

from pushgraph.cli import main

if __name__ == "__main__":  # processes that a training starts import this again
    main()
