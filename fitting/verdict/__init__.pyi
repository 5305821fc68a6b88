from .judgement import Judgement as Judgement, Level as Level, judge as judge
from .suspect import doubtful as doubtful, suspect as suspect
from .suspicion import Suspicion as Suspicion
