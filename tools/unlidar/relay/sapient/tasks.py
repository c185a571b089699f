"""Tasks: a node of static LiDARs can tell of itself, and rejects all else by its name."""

from sapient_msg.bsi_flex_335_v2_0.task_ack_pb2 import TaskAck
from sapient_msg.bsi_flex_335_v2_0.task_pb2 import Task

from unlidar.relay.sapient.registration import REQUESTS
from unlidar.sanitize import printable

_MOST_SHOWN = 80
_SUPPORTED = f"supported are the requests {', '.join(REQUESTS)}"


def answer(task: Task) -> tuple[TaskAck, str | None]:
    """The acknowledgement, and the request to be fulfilled if it is accepted."""
    asked = _asked(task)
    request = next((name for name in REQUESTS if asked == f"request {name.lower()}"), None)
    if request is not None:
        return TaskAck(task_id=task.task_id, task_status=TaskAck.TASK_STATUS_ACCEPTED), request
    rejected = TaskAck.TASK_STATUS_REJECTED
    reason = f"{asked} is not supported; {_SUPPORTED}"
    return TaskAck(task_id=task.task_id, task_status=rejected, reason=[reason]), None


def _asked(task: Task) -> str:
    if task.control != Task.CONTROL_START:
        return Task.Control.Name(task.control)
    kind = task.command.WhichOneof("command") if task.HasField("command") else None
    if kind is None:
        return "region" if task.region else "a task without command"
    if kind == "request":
        return f"request {printable(task.command.request.strip().lower()[:_MOST_SHOWN])}"
    if kind == "mode_change":
        return f"mode_change {printable(task.command.mode_change[:_MOST_SHOWN])}"
    return kind
