"""parmps: violent sloshing by the Moving Particle Semi-implicit method, in parallel."""

__version__ = "0.2.0"
