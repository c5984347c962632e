-- Health of a RobotOffload for Argo CD (docs/how-to/gitops.md): whether the cloud can serve, wherever the robot is.
local health = { status = "Progressing", message = "Waiting for the operator" }
local status = obj.status
if status == nil or status.conditions == nil then
  return health
end
if status.observedGeneration ~= nil and status.observedGeneration ~= obj.metadata.generation then
  health.message = "Waiting for the operator to see this generation"
  return health
end
local found = {}
for _, condition in ipairs(status.conditions) do
  found[condition.type] = condition
end
local ready, stalled = found["Ready"], found["Stalled"]
if stalled ~= nil and stalled.status == "True" then
  return { status = "Degraded", message = stalled.reason .. ": " .. stalled.message }
end
if ready == nil then
  return health
end
if ready.status ~= "True" then
  health.message = ready.reason .. ": " .. ready.message
  return health
end
if obj.spec.replicas == 0 then
  return { status = "Suspended", message = "spec.replicas is 0" }
end
local robot = found["Connected"]
local there = robot ~= nil and robot.status == "True"
return { status = "Healthy", message = there and ready.message or "Ready; the robot is not connected" }
