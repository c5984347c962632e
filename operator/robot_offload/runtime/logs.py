"""The operator's log: one JSON object (or one text) a line, for our own lines and the libraries'."""

from __future__ import annotations

import logging
import sys
from collections.abc import Mapping
from typing import Final

import structlog

from robot_offload.runtime.settings import LogFormat

_LAST: Final[Mapping[LogFormat, tuple[structlog.typing.Processor, ...]]] = {
    "json": (structlog.processors.format_exc_info, structlog.processors.JSONRenderer()),
    "text": (structlog.dev.ConsoleRenderer(colors=False),),
}


def set_up(level: str, form: LogFormat = "json") -> None:
    """Log to standard error, from `level` on."""
    shared: list[structlog.typing.Processor] = [
        structlog.stdlib.add_logger_name,
        structlog.stdlib.add_log_level,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        structlog.processors.StackInfoRenderer(),
    ]
    structlog.configure(
        processors=[
            structlog.stdlib.filter_by_level,
            *shared,
            structlog.stdlib.ProcessorFormatter.wrap_for_formatter,
        ],
        logger_factory=structlog.stdlib.LoggerFactory(),
        wrapper_class=structlog.stdlib.BoundLogger,
        cache_logger_on_first_use=True,
    )
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=shared,
            processors=[
                structlog.stdlib.ProcessorFormatter.remove_processors_meta,
                *_LAST[form],
            ],
        )
    )
    root = logging.getLogger()
    root.handlers = [handler]
    root.setLevel(level.upper())
    for noisy in ("asyncio", "aiohttp.access", "urllib3", "kubernetes"):
        logging.getLogger(noisy).setLevel("WARNING")
    # kopf.objects logs each event of the cluster.
    logging.getLogger("kopf.objects").setLevel("DEBUG" if level.lower() == "debug" else "WARNING")
