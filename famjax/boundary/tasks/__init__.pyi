from .executors import AnyExecutor as AnyExecutor, Submits as Submits
from .store import Store as Store, keepable as keepable
from .task_run import EngineLost as EngineLost, TaskRefused as TaskRefused, run_tasks as run_tasks
from .worker import can_travel as can_travel
