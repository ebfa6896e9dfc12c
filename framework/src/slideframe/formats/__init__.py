"""Other programs' file formats, one module each. Frames other than the local ENU exist only here."""
