"""What stands in single backticks in a docstring: a link where it names something public."""

from docutils import nodes
from sphinx import addnodes

from _site import reference


def public():
    """Give every public name, members of classes with them."""
    found = set()
    for module, value in reference.modules().items():
        found.add(module)
        for name in reference.names(value):
            found.add(f"{module}.{name}")
            found.update(f"{module}.{name}.{each}" for each in dir(getattr(value, name)))
    return found


PUBLIC = public()


def found(text, module, inside=None):
    """Give the full public name that a text names, or None."""
    plain = text.replace("gramian.models.", "gramian.").removesuffix("()")
    tried = [plain, f"{module}.{plain}", f"gramian.{plain}"]
    if inside and len(plain) > 1:
        tried.insert(0, f"{module}.{inside}.{plain}")
    return next((each for each in tried if each in PUBLIC), None)


def role(name, rawtext, text, lineno, inliner, options=None, content=None):
    """Give a link where the text names something public, else the text as code."""
    environment = inliner.document.settings.env
    context = environment.ref_context
    target = found(text, context.get("py:module", "gramian"), context.get("py:class"))
    literal = nodes.literal(rawtext, text, classes=["py"])
    if target is None:
        return [literal], []
    wanted = {"refdomain": "py", "reftype": "obj", "reftarget": target, "refwarn": False}
    return [addnodes.pending_xref(rawtext, literal, refdoc=environment.docname, **wanted)], []


def plain_types(app, doctree):
    """Keep of the links in the types of parameters those that name something public.

    Sphinx would take the n of "shape (m, n)" for any attribute called n.
    """
    for link in list(doctree.findall(addnodes.pending_xref)):
        if link.get("refdomain") != "py" or link["reftarget"] in PUBLIC:
            continue
        target = found(link["reftarget"], link.get("py:module") or "gramian")
        if target is None:
            chosen = [each for each in link if isinstance(each, addnodes.pending_xref_condition)]
            link.replace_self(chosen[-1].children if chosen else link.children)
        else:
            link["reftarget"] = target
            link["refspecific"] = False


def setup(app):
    """Make the role known, and the pass over the types."""
    app.add_role("name", role)
    app.connect("doctree-read", plain_types)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
