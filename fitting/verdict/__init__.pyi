from .judgement import Judgement as Judgement, Level as Level, judge as judge
from .series_judgement import judge_series as judge_series
from .suspect import doubtful as doubtful, suspect as suspect
from .suspicion import Suspicion as Suspicion
