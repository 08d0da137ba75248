"""A file per figure. Each has a FIGURE: its panels, their curves, and what the thesis says of them."""
