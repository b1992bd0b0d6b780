"""The SMPL body: the user's own model files, converted once, and the forward pass in numpy."""
