"""The tuning page: a server on this machine, and the files a browser shows."""

__all__: list[str] = []
