from .attendant import (
    Attendant as Attendant,
    LoadChange as LoadChange,
    Request as Request,
    Situation as Situation,
    Start as Start,
)
from .limits_and_gains import (
    Control as Control,
    Guards as Guards,
    RigSettings as RigSettings,
    floor_counts as floor_counts,
)
from .operator import (
    JOURNAL as JOURNAL,
    ports as ports,
    prepare as prepare,
    record_test as record_test,
)
from .output_steps import calibrate_feed_forward as calibrate_feed_forward
from .plan import (
    Isobaric as Isobaric,
    Plan as Plan,
    Step as Step,
    duration as duration,
    highest_pressure as highest_pressure,
    next_block as next_block,
    seconds_of as seconds_of,
)
from .plan_file import (
    PlanFile as PlanFile,
    isobaric_from_dict as isobaric_from_dict,
    read_plan as read_plan,
)
from .plan_run import (
    Machine as Machine,
    check_plan as check_plan,
    run as run,
)
from .rig import Rig as Rig
from .tripped import (
    acknowledge as acknowledge,
    device_status as device_status,
    trip_text as trip_text,
    unseen as unseen,
)
