"""Analysis of a STEP file's text without the CAD kernel: damaged lines, and the parts it should contain.

The kernel silently drops data that it cannot read, or crashes. The text shows which statements are damaged and how many
faces and instances each product has, so that losses can be named.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

_END = re.compile(rb";\s*+(?=#\d++\s*+=|ENDSEC|/\*|$)")  # not any semicolon, since strings may contain one
_STATEMENT = re.compile(rb"\s*+(?:/\*.*?\*/\s*)*#(\d++)\s*+=\s*+(.*)", re.DOTALL)
_TEXT = re.compile(rb"\S")
_WHOLE = re.compile(rb"#(\d++)\s*+=\s*+((?:[^;']|'(?:[^']|'')*+')*+);")
_USE = re.compile(rb"#(\d+)\s*=\s*NEXT_ASSEMBLY_USAGE_OCCURRENCE\s*\([^;#]*#(\d+)\s*,\s*#(\d+)")
_REFERENCE = re.compile(rb"#(\d+)")
_STRING = re.compile(rb"'(?:[^']++|'')*+'")
_SIMPLE = re.compile(rb"([A-Z][A-Z0-9_]*)\s*\(")
_BODY = re.compile(rb"(?:[A-Z][A-Z0-9_]*\s*)?\([A-Z0-9_#$*.,()+\-\s\"/!]*\)", re.DOTALL)
_SOUND = re.compile(
    rb"(?:\s++|/\*.*?\*/)*+#([1-9]\d*+)\s*+=\s*+((?:([A-Z][A-Z0-9_]*+)\s*+)?"
    rb"\((?:[A-Z0-9_#$*.,()+\-\"/!]++|'(?:[^']++|'')*+'|\s++(?!;))*+(?<=\)))\s*+;|(\S.*)",
    re.DOTALL,
)
"""a statement that can be read: number, body, keyword; else all that follows"""
_SHELLS = (b"CLOSED_SHELL", b"OPEN_SHELL")
_CONTEXT = re.compile(rb"GLOBAL_UNIT_ASSIGNED_CONTEXT\(\(([#\d,]*)\)\)")
_SI_LENGTH = re.compile(
    rb"SI_UNIT\((?:\$|\.(?:EXA|PETA|TERA|GIGA|MEGA|KILO|HECTO|DECA|DECI|CENTI|MILLI|MICRO|NANO|PICO|FEMTO|ATTO)\.),"
    rb"\.METRE\.\)"
)
_CONVERSION = re.compile(rb"CONVERSION_BASED_UNIT\(,#(\d+)\)")
_FACTOR = re.compile(rb"LENGTH_MEASURE_WITH_UNIT\((?:[A-Z_]+\()?(\d+\.?\d*(?:[Ee][-+]?\d+)?)\)?,#(\d+)\)")
_SHOWN = 3


@dataclass
class StepText:
    """Products and damage of a STEP file."""

    faces: Counter[str] = field(default_factory=Counter)
    """total number of faces of each product's instances, by product name"""
    instances: Counter[str] = field(default_factory=Counter)
    """number of uses of each product with its own shape, by product name"""
    external: list[str] = field(default_factory=list)
    """names of referenced files"""
    circular: dict[int, str] = field(default_factory=dict)
    """entity numbers of the uses by which an assembly contains itself, with its name"""
    damage: list[str] = field(default_factory=list)
    """one line for each damaged statement, in the order of the file"""
    unit_fault: str = ""
    """unit of length that the kernel would misread; "" if there is none"""
    no_unit: bool = False
    """whether a shape has no unit of length; the kernel then uses millimetres"""

    def damage_summary(self) -> str:
        """Return the damage in one line; "" if there is none."""
        if not self.damage:
            return ""
        more = f" and {len(self.damage) - _SHOWN} more" if len(self.damage) > _SHOWN else ""
        return "; ".join(self.damage[:_SHOWN]) + more

    def lost(self, instances: Counter[str], faces: Counter[str]) -> list[str]:
        """Return a line for each product with fewer instances or faces than the text states.

        `instances` and `faces`: numbers that were read, by product name.
        """
        if faces.total() == self.faces.total() and instances.total() == self.instances.total():
            return []  # names are compared only if totals differ, since the kernel may spell them differently
        notes = []
        for name, wanted in self.instances.items():
            expected, got = self.faces[name], instances[name]
            if got < wanted and not expected:
                notes.append(f"part {name} is left out: the file gives it no faces that can be read")
            elif got < wanted:
                notes.append(f"part {name} is lost: {got} of its {wanted} instances could be read")
            elif faces[name] < expected:
                notes.append(f"part {name} is incomplete: {faces[name]} of its {expected} faces could be read")
        return notes


@dataclass
class _Statements:
    """The statements that can be read of a file, by entity number."""

    data: bytes
    bodies: dict[int, bytes] = field(default_factory=dict)
    """what follows the equals sign"""
    bare: dict[int, bytes] = field(default_factory=dict)
    """`bodies` without strings"""
    kinds: dict[int, bytes] = field(default_factory=dict)
    """keywords of simple statements"""

    def references(self, number: int) -> list[int]:
        """Return the numbers that a statement names, in order."""
        return list(map(int, _REFERENCE.findall(self.bare.get(number, b""))))

    def of(self, *kinds: bytes) -> list[int]:
        """Return the numbers of the statements of some kinds."""
        return [n for n, kind in self.kinds.items() if kind in kinds]

    def line(self, place: int) -> int:
        """Return the line of the first text from an offset on."""
        text = _TEXT.search(self.data, place)
        return self.data.count(b"\n", 0, text.start() if text else place) + 1

    def line_of(self, number: int) -> int:
        """Return the line of the last statement of a number."""
        return self.line([m.start() for m in re.finditer(rb"#0*%d\s*=" % number, self.data)][-1])


def scan(data: bytes) -> StepText:
    """Analyse the text of a STEP file."""
    text = StepText()
    start = data.find(b"DATA;")
    if start < 0:
        text.damage.append("no DATA section")
        return text
    start += len(b"DATA;")
    end = data.rfind(b"ENDSEC;")
    statements = _statements(data, start, len(data) if end < start else end, text)
    _products(statements, text)
    _length_units(statements, text)
    return text


def _sound(data: bytes, start: int, end: int) -> _Statements | None:
    """Return the statements of a DATA section of which all can be read and all that is named exists; else None."""
    rows = _SOUND.findall(data, start, end)
    numbers = [row[0] for row in rows]
    if not rows or any(row[3] for row in rows):
        return None
    text = _STRING.sub(b"", b";".join([row[1] for row in rows]))
    marks = np.frombuffer(text + b";", np.uint8)
    depth = np.cumsum((marks == ord("(")).astype(np.int8) - (marks == ord(")")), dtype=np.int32)
    if len({*numbers}) < len(rows) or not {*_REFERENCE.findall(text)} <= {*numbers} or depth[marks == ord(";")].any():
        return None
    of = list(map(int, numbers))
    kinds = {n: row[2] for n, row in zip(of, rows, strict=True) if row[2]}
    return _Statements(
        data, dict(zip(of, (row[1] for row in rows), strict=True)), dict(zip(of, text.split(b";"), strict=True)), kinds
    )


def _statements(data: bytes, start: int, end: int, text: StepText) -> _Statements:
    """Return the statements of a DATA section; unreadable ones are added to `text.damage`."""
    sound = _sound(data, start, end)
    if sound is not None:
        return sound
    found = _Statements(data)
    damage: list[tuple[int, str]] = []
    position = start
    for stop in [*_END.finditer(data, start, end), None]:
        place, last = position, stop.start() if stop else end
        position = stop.end() if stop else end
        match = _STATEMENT.fullmatch(data, place, last)
        if match is None:
            if data[place:last].strip():
                damage.append((found.line(place), "the statement cannot be read"))
            continue
        number, body = int(match[1]), match[2].rstrip()
        bare = _STRING.sub(b"", body) if b"'" in body else body
        if b"'" in bare or bare.count(b"(") != bare.count(b")") or not _BODY.fullmatch(bare):
            damage.append((found.line(place), f"statement #{number} cannot be read"))
        elif number in found.bodies:
            damage.append((found.line(place), f"#{number} is defined a second time"))
        found.bodies[number], found.bare[number] = body, bare
        found.kinds.pop(number, None)
        if kind := _SIMPLE.match(body):
            found.kinds[number] = kind[1]
    for number in found.bodies:
        missing = next((r for r in found.references(number) if r not in found.bodies), None)
        if missing is not None:
            damage.append((found.line_of(number), f"#{number} names #{missing}, which does not exist"))
    text.damage = [f"line {line}: {message}" for line, message in sorted(damage)]
    return found


def _length_units(statements: _Statements, text: StepText) -> None:
    """Check the unit of every shape: the kernel silently reads an unknown unit as metres or millimetres.

    It supports metres with an SI prefix, and units converted to these by a factor.
    """

    def bare(n: int) -> bytes:
        return b"".join(statements.bare.get(n, b"").split())

    def is_si(body: bytes) -> bool:
        return b"LENGTH_UNIT()" in body and _SI_LENGTH.search(body) is not None

    def is_known(body: bytes) -> bool:
        conversion = _CONVERSION.search(body)
        if conversion is None:
            return is_si(body)
        factor = _FACTOR.fullmatch(bare(int(conversion[1])))
        known = factor is not None and 0.0 < float(factor[1]) < float("inf") and is_si(bare(int(factor[2])))
        return b"LENGTH_UNIT()" in body and known

    contexts = {
        references[-1]
        for n, kind in statements.kinds.items()
        if kind.endswith(b"SHAPE_REPRESENTATION")
        and kind != b"CONTEXT_DEPENDENT_SHAPE_REPRESENTATION"
        and (references := statements.references(n))
    }
    for context in [*contexts.difference(statements.bodies), *filter(contexts.__contains__, statements.bodies)]:
        assigned = _CONTEXT.search(bare(context))
        units = [int(n) for n in _REFERENCE.findall(assigned[1])] if assigned is not None else []
        units = [n for n in units if b"LENGTH_UNIT" in bare(n) or b"METRE" in bare(n)]
        unknown = next((n for n in units if not is_known(bare(n))), None)
        text.no_unit |= not units
        if unknown is not None and not text.unit_fault:
            statement = " ".join(statements.bodies[unknown].decode("ascii", "replace").split())[:100]
            statement = "".join(c if c.isprintable() else "?" for c in statement)
            line = statements.line_of(unknown)
            text.unit_fault = f"line {line}: #{unknown} is no length unit that is known: {statement}"


def _products(statements: _Statements, text: StepText) -> None:
    kinds, references, of = statements.kinds, statements.references, statements.of
    definitions = {}  # product definition -> name
    for n in of(b"PRODUCT_DEFINITION", b"PRODUCT_DEFINITION_WITH_ASSOCIATED_DOCUMENTS"):
        formation = next(iter(references(n)), -1)
        product = next((r for r in references(formation) if kinds.get(r) == b"PRODUCT"), -1)
        strings = _STRING.findall(statements.bodies.get(product, b""))
        if len(strings) >= 2:
            name = strings[1] if len(strings[1]) > 2 else strings[0]
            definitions[n] = _text(name)
    for n in of(b"DOCUMENT_FILE"):
        text.external.extend(_text(s) for s in _STRING.findall(statements.bodies[n])[:1])
    named = ((n, references(n)) for n in of(b"PRODUCT_DEFINITION_SHAPE"))
    shapes = {n: ends[0] for n, ends in named if ends}
    equal: dict[int, list[int]] = {}
    for n in of(b"SHAPE_REPRESENTATION_RELATIONSHIP"):
        if len(references(n)) == 2:
            a, b = references(n)
            equal.setdefault(a, []).append(b)
            equal.setdefault(b, []).append(a)
    own: dict[int, int] = {}
    for n in of(b"SHAPE_DEFINITION_REPRESENTATION"):
        if len(ends := references(n)) == 2 and (definition := shapes.get(ends[0])) in definitions:
            own[definition] = _count_faces([ends[1], *equal.get(ends[1], [])], statements)
    named = ((n, references(n)) for n in of(b"NEXT_ASSEMBLY_USAGE_OCCURRENCE"))
    uses = [(n, ends[0], ends[1]) for n, ends in named if len(ends) >= 2]
    children, circular = _tree(uses)
    text.circular = {n: definitions.get(parent, f"#{parent}") for n, parent in circular.items()}
    used = {child for below in children.values() for child in below}
    times: Counter[int] = Counter()

    def walk(definition: int) -> None:
        times[definition] += 1
        for child in children.get(definition, ()):
            walk(child)

    for definition in definitions:
        if definition not in used:
            walk(definition)
    for definition, count in own.items():
        if count or (definition not in children and not text.external):  # else its shape may be in another file
            name = definitions[definition]
            text.faces[name] += count * times[definition]
            text.instances[name] += times[definition]


def circular_uses(data: bytes) -> set[int]:
    """Return the numbers of the uses by which an assembly in a STEP file contains itself."""
    return set(_tree([(int(m[1]), int(m[2]), int(m[3])) for m in _USE.finditer(data)])[1])


def _tree(uses: Iterable[tuple[int, int, int]]) -> tuple[dict[int, list[int]], dict[int, int]]:
    """Return the children of each definition, and the circular ones of `uses` (number, parent, child) with parents."""
    children: dict[int, list[int]] = {}
    circular: dict[int, int] = {}
    for n, parent, child in sorted(uses):
        if _reaches(child, parent, children):
            circular[n] = parent
        else:
            children.setdefault(parent, []).append(child)
    return children, circular


def without(data: bytes, uses: set[int]) -> bytes:
    """Return a STEP file without some uses of products, and without what places these."""
    statements = [(int(match[1]), match) for match in _WHOLE.finditer(data)]
    dropped = set(uses)
    for kind in (b"PRODUCT_DEFINITION_SHAPE", b"CONTEXT_DEPENDENT_SHAPE_REPRESENTATION"):
        for n, match in statements:
            body = _STRING.sub(b"", match[2])
            if body.startswith(kind) and dropped.intersection(map(int, _REFERENCE.findall(body))):
                dropped.add(n)
    kept, position = [], 0
    for n, match in statements:
        if n in dropped:
            kept.append(data[position : match.start()])
            position = match.end()
    return b"".join([*kept, data[position:]])


def _reaches(start: int, end: int, children: dict[int, list[int]]) -> bool:
    """Whether a definition is another one or below it."""
    seen, front = {start}, [start]
    while front:
        n = front.pop()
        if n == end:
            return True
        fresh = [child for child in children.get(n, ()) if child not in seen]
        seen.update(fresh)
        front += fresh
    return False


def _text(string: bytes) -> str:
    return string[1:-1].replace(b"''", b"'").decode("utf-8", "replace").strip()


def _count_faces(roots: list[int], statements: _Statements) -> int:
    """Count the faces named by the shells below representations; the faces themselves may be unreadable."""
    seen, front, faces = set(roots), list(roots), set()
    while front:
        n = front.pop()
        if statements.kinds.get(n) in _SHELLS:
            faces.update(statements.references(n))
            continue
        for r in statements.references(n):
            if r not in seen:
                seen.add(r)
                front.append(r)
    return len(faces)
