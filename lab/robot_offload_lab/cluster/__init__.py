"""A small real Kubernetes for the tests: its programs are built from Go modules, without a container registry.

`control_plane.ControlPlane` runs on loopback as any user: etcd, kube-apiserver, kube-controller-manager, with kubectl
and helm beside it. `cluster.Cluster` also has nodes, and robots outside, all made of namespaces; it needs root.
"""
