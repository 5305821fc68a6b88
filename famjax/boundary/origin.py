"""Where a file of results comes from: when it was written, and by which command."""

import dataclasses
import datetime
import shlex
import sys


@dataclasses.dataclass(frozen=True)
class Origin:
    """What a file says of its own making.

    Attributes:
        date: of writing, ISO 8601 with the offset from UTC.
        command: that a person would repeat.
    """

    date: str
    command: str

    @classmethod
    def of_this_command(cls) -> "Origin":
        """That of the running `famjax` command: now, and its arguments."""
        now = datetime.datetime.now(datetime.UTC).astimezone()
        return cls(now.isoformat(timespec="seconds"), shlex.join(["famjax", *sys.argv[1:]]))

    def as_dict(self) -> dict[str, str]:
        """For JSON."""
        return dataclasses.asdict(self)

    def comments(self) -> list[str]:
        """Lines of a CSV file that every reader of force maps leaves out.

        >>> Origin("2026-01-31T12:00:00+00:00", "famjax ramps a.csv=83mm").comments()
        ['# date: 2026-01-31T12:00:00+00:00', '# command: famjax ramps a.csv=83mm']
        """
        return [f"# date: {self.date}", f"# command: {self.command}"]
