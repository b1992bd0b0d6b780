"""The one exception for everything a user can put right."""


class DrapeError(ValueError):
    """A sentence for the user: where, what was found, what was expected, what to do."""
