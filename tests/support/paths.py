"""Where the repository is, and what stands beside it."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
SHARED = ROOT.parent / "shared"
RECORDINGS = SHARED / "recordings"
