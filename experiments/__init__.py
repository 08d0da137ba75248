"""The learning results of the thesis, figure by figure, with our own algorithms (README.md shows them)."""
