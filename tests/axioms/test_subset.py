"""The files keep to what clingo 5.8 and 6 read alike, told from their syntax trees.

What clingo 6 dropped or changed: anonymous variables under negation are unsafe; division and modulo
round down instead of towards zero; integers do not wrap at 2^31; scripts are gone. So the files use
only the constructs listed here, and arithmetic that cannot become negative.
"""

import pytest
from clauses import list_files, parse, read_file
from clingo import ast

STATEMENTS = {
    ast.ASTType.Comment,
    ast.ASTType.Program,
    ast.ASTType.Defined,
    ast.ASTType.Rule,
    ast.ASTType.Minimize,
    ast.ASTType.ShowSignature,
    ast.ASTType.ShowTerm,
}
PARTS = {
    ast.ASTType.Literal,
    ast.ASTType.SymbolicAtom,
    ast.ASTType.BooleanConstant,
    ast.ASTType.Comparison,
    ast.ASTType.Guard,
    ast.ASTType.ConditionalLiteral,
    ast.ASTType.Aggregate,
    ast.ASTType.BodyAggregate,
    ast.ASTType.BodyAggregateElement,
    ast.ASTType.Function,
    ast.ASTType.SymbolicTerm,
    ast.ASTType.Variable,
    ast.ASTType.Interval,
    ast.ASTType.UnaryOperation,
    ast.ASTType.BinaryOperation,
}
LARGEST = 10_000
SIGNS = {ast.BinaryOperator.Plus: 1, ast.BinaryOperator.Minus: -1}


def walk(node):
    """A node and all below it."""
    yield node
    for key in node.child_keys:
        child = getattr(node, key)
        children = child if isinstance(child, ast.ASTSequence) else [child]
        for one in children:
            if one is not None:
                yield from walk(one)


def find_faults(text):
    """What clingo 5.8 and 6 might read differently in a program."""
    faults = []
    for statement in parse(text):
        if statement.ast_type not in STATEMENTS:
            faults.append(f"a statement of kind {statement.ast_type.name}: {statement}")
            continue
        if statement.ast_type == ast.ASTType.Comment:
            continue
        if statement.ast_type == ast.ASTType.Program:
            if (statement.name, len(statement.parameters)) != ("base", 0):
                faults.append(f"a program part: {statement}")
            continue
        for node in walk(statement):
            fault = "" if node is statement else judge(node)
            if fault:
                faults.append(f"{fault}: {statement}")
    return faults


def judge(node):
    """What is wrong with one part of a statement; empty if nothing is."""
    kind = node.ast_type
    if kind not in PARTS:
        return f"a part of kind {kind.name}"
    if kind == ast.ASTType.Variable and node.name == "_":
        return "an anonymous variable"
    if kind == ast.ASTType.Function and node.external:
        return "a call of Python"
    if kind == ast.ASTType.UnaryOperation and node.argument.ast_type != ast.ASTType.SymbolicTerm:
        return "a term that may be negative"
    if kind == ast.ASTType.SymbolicTerm and str(node.symbol).lstrip("-").isdigit():
        return "a large number" if abs(node.symbol.number) > LARGEST else ""
    if kind == ast.ASTType.BinaryOperation:
        return judge_operation(node)
    return ""


def judge_operation(node):
    """Sums and differences will do, and modulo of what cannot be negative: X, X+Y, X+M-Y."""
    if node.operator_type == ast.BinaryOperator.Modulo:
        terms, modulus = list(add_up(node.left)), str(node.right)
        less = [text for sign, text in terms if sign < 0]
        if less and ((1, modulus) not in terms or len(less) > 1):
            return "modulo of what may be negative"
        return ""
    if node.operator_type not in SIGNS:
        return f"the operator {ast.BinaryOperator(node.operator_type).name}"
    return ""


def add_up(term, sign=1):
    """The summands of a term, with their signs."""
    if term.ast_type == ast.ASTType.BinaryOperation and term.operator_type in SIGNS:
        yield from add_up(term.left, sign)
        yield from add_up(term.right, sign * SIGNS[term.operator_type])
    else:
        yield sign, str(term)


@pytest.mark.parametrize("file", list_files())
def test_file_keeps_to_the_common_subset(file):
    assert find_faults(read_file(file)) == []


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a(X) :- b(X), not c(X,_).", "anonymous"),
        ("a(X) :- b(X,_).", "anonymous"),
        ("a((X-Y)\\M) :- b(X,Y,M).", "may be negative"),
        ("a((X+M-Y-Z)\\M) :- b(X,Y,Z,M).", "may be negative"),
        ("a(X/2) :- b(X).", "Division"),
        ("a(2**X) :- b(X).", "Power"),
        ("a(@f(X)) :- b(X).", "call of Python"),
        ("a(3000000000).", "large number"),
        ("a(-X) :- b(X).", "negative"),
        ("a(|X|) :- b(X).", "negative"),
        ("a(X;Y) :- b(X,Y).", "kind"),
        ("a :- #sum+ { 1 : b } > 0, &t { 1 }.", "kind"),
        ("#external a.", "External"),
        ("#const n = 3.", "Definition"),
        ("#heuristic a. [1,true]", "Heuristic"),
        ("#project a/1.", "Project"),
        ("#edge (1,2).", "Edge"),
        ("#program step(t). a(t).", "program part"),
        ("#script (python) \nimport sys\n#end.", "Script"),
    ],
)
def test_what_would_differ_is_noticed(text, told):
    faults = find_faults(text)
    assert faults
    assert told in " ".join(faults)
