"""The arbiter: constitutive law and Material Point Method in float64 NumPy."""
