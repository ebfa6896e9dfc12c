"""The release: the mass that moves, in the local frame. What `Region` describes, worked out for one survey."""
