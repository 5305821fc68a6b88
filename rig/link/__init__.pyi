from .abstract_link import AbstractLink as AbstractLink
from .command_queue import Command as Command
from .events import Event as Event, Lost as Lost, Reset as Reset, Silent as Silent, Timing as Timing
from .mean_counts import mean_counts as mean_counts
from .serial_link import Link as Link, Port as Port, serial_opener as serial_opener
from .session import ALIVE as ALIVE, HEARTBEAT as HEARTBEAT, Session as Session
from .virtual_link import VirtualLink as VirtualLink
