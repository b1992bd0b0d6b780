"""The scenes of ``conf/scene``, a function each: sizes in, a checked Scene out."""
