"""VTO motions [Santesteban 2019], as HOOD trains on them, read into the schema of data sets of garments."""
