"""For all tests: no deadlines inside hypothesis, because a busy machine is no fault (timings belong in benchmarks).

And Ctrl-C works: a run that a shell has put into the background ignores SIGINT, and so would all that it starts.
"""

from __future__ import annotations

import signal

import hypothesis

hypothesis.settings.register_profile("no-deadline", deadline=None)
hypothesis.settings.load_profile("no-deadline")
signal.signal(signal.SIGINT, signal.default_int_handler)
