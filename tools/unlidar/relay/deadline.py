"""Waiting for the other side of a connection, with an end."""

import asyncio
import contextlib
from collections.abc import AsyncIterator


@contextlib.asynccontextmanager
async def deadline(seconds: float, fault: str) -> AsyncIterator[None]:
    """ConnectionError of the fault, such as "no answer within", if the block takes longer."""
    try:
        async with asyncio.timeout(seconds):
            yield
    except TimeoutError as error:
        raise ConnectionError(f"{fault} {seconds:g} s") from error
