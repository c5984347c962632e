{{/*
What the operator does, as rules of a Role. The tests compare them with robot_offload.kube.kinds.USES, both ways.
*/}}
{{- define "robot-offload.rules" -}}
{{- $keep := list "get" "list" "watch" "create" "patch" "delete" -}}
# What users want, and what became of it.
- apiGroups: [robotoffload.dev]
  resources: [robotoffloads]
  verbs: [get, list, watch]
- apiGroups: [robotoffload.dev]
  resources: [robotoffloads/status]
  verbs: [patch]
# Children say that their RobotOffload is not gone before they are (blockOwnerDeletion); OpenShift asks for this right.
- apiGroups: [robotoffload.dev]
  resources: [robotoffloads/finalizers]
  verbs: [update]
# What a RobotOffload is made of.
- apiGroups: [""]
  resources: [serviceaccounts, secrets, configmaps, services]
  verbs: {{ toJson $keep }}
- apiGroups: [apps]
  resources: [deployments, statefulsets]
  verbs: {{ toJson $keep }}
- apiGroups: [batch]
  resources: [jobs]
  verbs: {{ toJson $keep }}
- apiGroups: [networking.k8s.io]
  resources: [networkpolicies]
  verbs: {{ toJson $keep }}
# The robot's Lease, and the right of the reporter beside the agent to renew it: nobody can grant more than they have.
- apiGroups: [coordination.k8s.io]
  resources: [leases]
  verbs: {{ toJson $keep }}
- apiGroups: [rbac.authorization.k8s.io]
  resources: [roles, rolebindings]
  verbs: {{ toJson $keep }}
# Why a workload is not available; transitions, and why the API server refuses pods.
- apiGroups: [""]
  resources: [pods]
  verbs: [list, watch]
- apiGroups: [""]
  resources: [events]
  verbs: [create, list]
{{- if .Values.certManager.enabled }}
# Certificates of the user's own issuer.
- apiGroups: [cert-manager.io]
  resources: [certificates]
  verbs: [get, list, create, patch, delete]
{{- end }}
{{- end }}

{{/* The same for what lives in no namespace. */}}
{{- define "robot-offload.clusterrules" -}}
# Addresses of a Service of type NodePort.
- apiGroups: [""]
  resources: [nodes]
  verbs: [list]
# Since when writers of RobotOffloads are asked for their rights: what was written before is checked before it acts.
- apiGroups: [admissionregistration.k8s.io]
  resources: [validatingadmissionpolicies, validatingadmissionpolicybindings]
  resourceNames: [{{ include "robot-offload.clustername" . }}]
  verbs: [get]
{{- end }}
