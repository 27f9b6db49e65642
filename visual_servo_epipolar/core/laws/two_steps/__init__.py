"""Two steps: the laws of the paper, their equations, gains and settling times."""
