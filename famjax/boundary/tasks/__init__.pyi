from .executors import AnyExecutor as AnyExecutor, Submits as Submits
from .run import EngineLost as EngineLost, TaskRefused as TaskRefused, run_tasks as run_tasks
from .store import Store as Store, keepable as keepable
from .worker import can_travel as can_travel
