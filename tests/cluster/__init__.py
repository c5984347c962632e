"""A small real Kubernetes for the tests: its programs are built from Go modules, everything runs on loopback.

So far the control plane: etcd, kube-apiserver, kube-controller-manager, with kubectl and helm beside it.
"""
