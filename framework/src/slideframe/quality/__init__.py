"""How good a survey is, told from the survey alone: coverage, positions, pictures, and whether to fly again."""
