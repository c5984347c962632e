"""For all tests: hypothesis draws the same examples in each run, and no time limits: a busy machine is no fault.

So what passes once passes everywhere. New examples are looked for with `--hypothesis-profile=explore`.

And Ctrl-C works: a run that a shell has put into the background ignores SIGINT, and so would all that it starts.
"""

from __future__ import annotations

import signal

import hypothesis

patient = hypothesis.settings(deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow])
hypothesis.settings.register_profile("same", patient, derandomize=True, database=None)
hypothesis.settings.register_profile("explore", patient, derandomize=False)
hypothesis.settings.load_profile("same")
signal.signal(signal.SIGINT, signal.default_int_handler)
