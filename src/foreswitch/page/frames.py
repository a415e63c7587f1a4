"""uvicorn's WebSocket, with an end to what one client may pile up without ever sending a message.

The class is of uvicorn's inside, so pyproject.toml keeps uvicorn below the first version that was not tried with it.
"""

from __future__ import annotations

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import CloseCode, Frame

__all__ = ["Frames"]

#: Fragments of one message: a browser sends none.
MOST_FRAGMENTS = 1024
#: Bytes of pongs that a client may leave unread.
MOST_UNREAD = 1 << 20


class Frames(WebSocketsSansIOProtocol):
    """Fragments without length are never too long together, and pongs are written whether or not anybody reads."""

    def handle_cont(self, event: Frame) -> None:
        """The next fragment."""
        if len(self.frames) < MOST_FRAGMENTS:
            super().handle_cont(event)
        elif not self.close_sent:
            self.conn.fail(CloseCode.MESSAGE_TOO_BIG, "too many fragments")
            self.handle_parser_exception()

    def handle_ping(self) -> None:
        """Answered, unless the answers are not read."""
        if self.transport.get_write_buffer_size() > MOST_UNREAD:
            self.transport.abort()
        else:
            super().handle_ping()
