"""What a log's file holds, as `look` begins with it."""

from diffthrust.logs._contents import contents  # private: look goes on to guess

__all__ = ["contents"]
