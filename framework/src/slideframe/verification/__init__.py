"""Verification of solvers against closed-form solutions and measurements, through the public Solver interface alone."""
