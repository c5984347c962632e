{{/* Name of everything that belongs to the operator itself. */}}
{{- define "robot-offload.fullname" -}}
{{- printf "%s-operator" (.Release.Name | trunc 50 | trimSuffix "-") }}
{{- end }}

{{/* Name of cluster-scoped objects: two releases of one name in two namespaces must not share them. */}}
{{- define "robot-offload.clustername" -}}
{{- printf "%s-%s" .Release.Namespace (include "robot-offload.fullname" .) }}
{{- end }}

{{- define "robot-offload.serviceaccount" -}}
{{- if .Values.serviceAccount.create }}
{{- default (include "robot-offload.fullname" .) .Values.serviceAccount.name }}
{{- else }}
{{- required "serviceAccount.name is needed when serviceAccount.create is false" .Values.serviceAccount.name }}
{{- end }}
{{- end }}

{{/* `robot-offload` alone is the name label of what the operator makes for a robot: its policies must not match here. */}}
{{- define "robot-offload.selectorlabels" -}}
app.kubernetes.io/name: robot-offload-operator
app.kubernetes.io/instance: {{ .Release.Name }}
{{- end }}

{{- define "robot-offload.labels" -}}
{{ include "robot-offload.selectorlabels" . }}
app.kubernetes.io/version: {{ .Chart.AppVersion | quote }}
{{- with .Values.commonLabels }}
{{ toYaml . }}
{{- end }}
app.kubernetes.io/managed-by: {{ .Release.Service }}
helm.sh/chart: {{ printf "%s-%s" .Chart.Name .Chart.Version | replace "+" "_" }}
{{- end }}

{{/* Reference of one of our images: (list . "agent"). */}}
{{- define "robot-offload.image" -}}
{{- $root := index . 0 }}
{{- $name := index . 1 }}
{{- $images := $root.Values.images }}
{{- default (printf "%s/%s:%s" (trimSuffix "/" $images.registry) $name (default $root.Chart.AppVersion $images.tag)) (get $images $name) }}
{{- end }}

{{/* The link of an alert to its section: (list BASE "robotoffloadnoleader"); nothing without a base. */}}
{{- define "robot-offload.runbook" -}}
{{- if index . 0 }}{{ printf "\n            runbook_url: %s#%s" (index . 0) (index . 1) }}{{ end }}
{{- end }}
