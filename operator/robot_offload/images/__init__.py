"""Container images: Dockerfiles for ROS 2 nodes from a specification, and the programs that build them.

`spec` defines the options, `values` and `quoting` keep hostile text out, `features` own the text, `dockerfiles`
assembles it. All of that is pure. `builders` runs docker, podman or buildah; `ours` builds the project's own images.
"""
