"""A small real Kubernetes for the tests: its programs are built from Go modules, nothing comes from a registry.

`control_plane.ControlPlane` runs on loopback as any user: etcd, kube-apiserver, kube-controller-manager, with kubectl
and helm beside it. `cluster.Cluster` has nodes, too, and robots outside, all made of namespaces; it needs root.
"""
