"""Laws as tables of splines with a certified error."""
