"""How many cases hypothesis tries."""

from hypothesis import settings


def examples(count: int) -> settings:
    """So many cases of a law; twenty times as many under the profile `thorough`."""
    return settings(max_examples=count * settings.default.max_examples // 100)
