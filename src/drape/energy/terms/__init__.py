"""Energy terms, a file each with what is its own: what an incremental potential is a sum of."""
