"""States of scenes as graphs: what is near what, what can move, and the features of nodes and edges."""
