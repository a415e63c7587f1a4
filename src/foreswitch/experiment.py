"""Design of a pulse test before it is run."""

__all__: list[str] = []
