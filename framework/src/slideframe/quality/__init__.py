"""How good a survey is, and the surface made from it: coverage, positions, pictures, whether to fly again."""
