"""The console: one page in the browser over a cluster, a recording or the running demo."""
