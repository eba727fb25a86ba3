"""What the name of a part says of it as a fastener: kind, sizes, standard, head; in English, German and shop shorthand.

A name alone makes nothing a fastener: `constraints.recognition.fasteners` holds it against the geometry.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass

INSTANCE = re.compile(r":\d+$|\s*\(\d+\)|\bv\d+$|\.(step|stp|stl|ipt|sldprt|prt)$", re.IGNORECASE)
"""numbers of instances and versions at the end of a name"""
DECIMAL = re.compile(r"(?<![\d.,])(?<!\d_)(\d{1,2})[_,](\d)(?=\s?[xX×*]|$|[\s_])")
"""a decimal point that a file system could not take: "M2_5X10" """
KINDS = {
    "threaded insert": r"heat ?set|heat ?insert|insert|einpress|gewindeeinsatz|rivnut|helicoil|knurled nut",
    "self-tapping screw": r"self ?-?tap|tapping|taptite|blechschraube|bts\d?|pt screw|wood ?screw|thread ?forming"
    r"|plastite|din 798[123]|iso 148[123]|iso 7049|iso 7050",
    "set screw": r"set ?screw|grub|gewindestift|madenschraube|sss|din 91[3-6]|iso 402[6-9]|iso 4766",
    "threaded rod": r"threaded ?rod|gewindestange|all ?thread|lead ?screw|stud|din 97[56]",
    "nut": r"\w*nuts?|\w*mutter|sex ?-?bolt|binding (?:post|barrel)|threaded [\w ]*(?:standoff|spacer)|stand ?-?off"
    r"|din (?:934|985|980|439|557|562|1587|6923|6926)|iso (?:4032|4033|4034|4035|4036|7040|10511)",
    "washer": r"\w*washer|\w*scheibe|shims?|federring|din (?:125|126|127|433|440|6796|6797|6798|7980|9021|988)"
    r"|iso (?:7089|709\d)",
    "bushing": r"(?:sleeve|plain|slide) ?bearing|\w*bush(?:ing)?|\w*buchse|gleitlager|spacer|sleeve|distanz\w*",
    "bearing": r"(?:\w*bearing|\w*lager|\w*wälzlager|f?(?:6[0-9]{2,4}|mr\d{2,3})-?(?:zz|2rs1?|2z|rs|z)?|lm\d{1,2}l?uu)",
    "circlip": r"circlips?|(?:retaining|snap|lock) ?ring|e ?-?clip|seeger\w*|sicherungsring|sprengring"
    r"|din (?:471|472|6799|7993)|iso 464",
    "screw": r"\w*screws?|\w*bolts?|\w*schraube|[sbfphlc]hc?s"
    r"|din (?:84|85|603|6912|7984|7985|7991|912|93[13]|960|961|96[3-7])"
    r"|iso (?:1207|1580|2009|2010|4014|4017|4762|7045|7046|7047|7048|7379|7380|8676|8765|10642|1458[0-4])",
    "magnet": r"\w*magnets?",
    "seal": r"o ?-?rings?|quad ?ring|\w*seals?|gasket|\w*dichtung|\w*dichtring",
    "belt": r"\w*belts?|\w*riemen",
    "key": r"parallel ?key|woodruff|feather ?key|passfeder|key|din 688[58]",
    "spring": r"\w*springs?|\w*feder",
    "cable tie": r"zip ?-?ties?|cable ?ties?|kabelbinder",
    "rivet": r"\w*rivets?|\w*niet",
    "dowel": r"\w*dowels?|pins?|\w*stift|splint|din (?:7|6325|1481|1443|1444)|iso (?:2338|2340|2341|8734|8735|8752)",
}
"""kind -> words that name it; the first kind that is named counts: a spring washer is a washer"""
KINDS_OF = {kind: re.compile(rf"(?<![a-zäöü0-9])(?:{words})(?![a-zäöü0-9])") for kind, words in KINDS.items()}
BESIDE = re.compile(
    r"\b(?:holder|mount|bracket|housing|plate|block|cover|caps?|carrier|carriage|clip|seat|clamp|guide|driver|wrench|body"
    r"|assembly|pocket|hole|cutout|jig|tool|tray|box|case|pulley|adapter|support|retainer|extrusion|trap|header|connector)\b"
)
"""what follows the word of a kind where the part is made for a fastener and is none"""
HEADS = {
    "dome": r"bhcs|bhs|bts\d?|phs|button|linsen\w*|pan ?head|round ?head|iso 7380\S*|iso 7045|din 7985",
    "countersunk": r"fhcs|fhs|flat ?head|countersunk|csk|senk\w*|din 7991|din 96[35]|iso 10642|iso 7046|iso 2009",
    "hexagon": r"hex(?:agon)? ?(?:head|bolt|screw)|sechskantschraube|din 93[13]|iso 401[47]",
    "cylinder": r"shcs|shs|socket ?head|cap ?screw|zylinder\w*|din 912|iso 4762|din 7984|din 84|iso 1207",
}
"""head form -> words that name it"""
HEADS_OF = {form: re.compile(rf"(?<![a-z0-9])(?:{words})(?![a-z0-9])") for form, words in HEADS.items()}
NUMBER = r"(\d+(?:\.\d+)?)"
METRIC = re.compile(rf"(?<![a-z0-9.])m ?{NUMBER}(?![0-9])")
AGAIN = rf"(?: ?[x×*] ?[a-z]{{0,2}} ?{NUMBER})"
TIMES = re.compile(rf"(?<![a-z0-9.])([a-z]{{0,3}}) ?{NUMBER}(?: ?mm)?{AGAIN}{AGAIN}?")
"""sizes multiplied: "m3x8", "5x7x8", "d5x40", "m3xd5x30" """
STANDARD = re.compile(r"\b(iso|din) ?(\d+)(-\d)?\b")


@dataclass(frozen=True)
class NameHint:
    """What a name says."""

    kind: str = ""
    """value of `FastenerKind`; empty if none is named"""
    word: str = ""
    """that names it"""
    diameter: float = 0.0
    """m: of a metric thread"""
    sizes: tuple[float, ...] = ()
    """m: all that are multiplied, the first one first"""
    standard: str = ""
    """as stated: "DIN 912" """
    head: str = ""
    """form of the head: "dome", "countersunk", "hexagon", "cylinder" """
    text: str = ""

    @property
    def length(self) -> float:
        """m: the last of the sizes multiplied; 0 if none is stated."""
        return self.sizes[-1] if len(self.sizes) > 1 else 0.0


def base_name(name: str) -> str:
    """Return a part's own name, without the path in the product tree and numbers of instances and versions."""
    own = name.rsplit("/", 1)[-1].strip().removeprefix("_")
    while (short := INSTANCE.sub("", own).strip()) not in (own, ""):
        own = short
    return own


def name_words(name: str) -> tuple[str, ...]:
    """Return the words of a part's own name in their order, in lower case: "M3x8 BHCS v2:18" has "m3x8", "bhcs"."""
    own = base_name(name)
    own = DECIMAL.sub(r"\1.\2", own)
    own = re.sub(r"(?<=[a-zäöü])(?=[A-Z])", " ", own)  # SocketHeadCapScrew
    own = re.sub(r"(?<=[A-Za-z]{3})(?=\d)", " ", own)  # Screw001, DIN912
    return tuple(word for word in re.split(r"[\s_,;:()\[\]|/]+|-(?=[a-z]{3})|(?<=\s)-(?=\s)", own.lower()) if word)


def name_hint(words: Collection[str]) -> NameHint:
    """Return what the words of a name say, in their order."""
    text = " ".join(words)
    kind, word = "", ""
    for of, pattern in KINDS_OF.items():
        found = pattern.search(text)
        if found and not BESIDE.search(text, found.end()):
            kind, word = of, found[0]
            break
    metric = METRIC.search(text) or re.search(rf"(?<![a-z0-9.])m ?{NUMBER}(?= ?[x×*])", text)
    times = TIMES.search(text)
    sizes = tuple(1e-3 * float(x) for x in times.groups()[1:] if x) if times else ()
    stated = STANDARD.search(text)
    return NameHint(
        kind,
        word,
        1e-3 * float(metric[1]) if metric else 0.0,
        sizes,
        f"{stated[1].upper()} {stated[2]}{stated[3] or ''}" if stated else "",
        next((form for form, pattern in HEADS_OF.items() if pattern.search(text)), ""),
        text,
    )
