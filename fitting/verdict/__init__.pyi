from .judgement import Judgement as Judgement, Level as Level, judge as judge
from .suspect import Suspicion as Suspicion, doubtful as doubtful, suspect as suspect
