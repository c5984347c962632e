"""Runs the operator as a process: triggers, queue, leadership, health, metrics, logs, settings. Decides nothing."""
