"""Builds parts of Kubernetes objects, purely: names, labels, owners, pods, policy rules, and needed facts."""
