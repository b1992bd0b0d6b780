"""CLOTH3D as it is distributed [Bertiche 2020], read into the schema of data sets of garments."""
