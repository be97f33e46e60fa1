# SPDX-License-Identifier: BSD-2-Clause
"""Commands that refuse an option which is given twice but counts once."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand


class OnceCommand(TyperCommand):
    """A command of typer that does not silently drop what was given first."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse as usual; wrong use if an option with a single value is given twice."""
        _, _, order = self.make_parser(ctx).parse_args(args=list(args))
        for parameter in order:
            single = parameter.param_type_name == "option" and not parameter.multiple
            if single and not getattr(parameter, "is_flag", False) and order.count(parameter) > 1:
                ctx.fail(f"{parameter.opts[0]} is given twice")
        return super().parse_args(ctx, args)
