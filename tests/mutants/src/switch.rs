//! One source file with its mutants compiled in: each is an arm beside the author's code, and
//! `crate::active_mutant` selects one of them.
//!
//! An operand occurs in every arm. The arms of mutants contain it unchanged, so the number of arms
//! is the sum over nested mutants, not their product.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use syn::spanned::Spanned;
use syn::visit::Visit;

use crate::list::{Genre, Mutant, Place};

/// A file for the copy, with the position of each mutant in it.
pub struct Switched {
    /// The whole file.
    pub text: String,
    /// The byte range in `text` of each arm or insertion, with its mutant.
    pub arms: Vec<(Range<usize>, usize)>,
    /// Mutants that no switch can reach: in a constant, in a `let` chain, in a macro.
    pub unswitched: Vec<usize>,
}

/// `text` with `mutants` (number and mutant) compiled in; `still_const` names functions that are
/// used where only constants are allowed.
pub fn switched(
    text: &str,
    mutants: &[(usize, &Mutant)],
    still_const: &BTreeSet<String>,
) -> Result<Switched, String> {
    let syntax = syn::parse_file(text).map_err(|error| error.to_string())?;
    let lines = Lines::of(text);
    let mut sites = Sites {
        source: text,
        wanted: BTreeMap::new(),
        found: Vec::new(),
        lifted: Vec::new(),
        still_const,
        open: false,
        lift: None,
    };
    for &(number, mutant) in mutants {
        let place = (lines.offset(mutant.span.start), mutant.genre as u8);
        sites
            .wanted
            .entry(place)
            .or_default()
            .push((number, mutant.replacement.clone()));
    }
    sites.visit_file(&syntax);
    let placed: BTreeSet<usize> = sites
        .found
        .iter()
        .flat_map(|site| site.arms.iter().map(|(number, _)| *number))
        .collect();
    let unswitched = mutants
        .iter()
        .map(|&(number, _)| number)
        .filter(|number| !placed.contains(number));
    let unswitched = unswitched.collect();
    let mut site_list = sites.found;
    site_list.extend(sites.lifted.into_iter().map(|range| Site {
        range,
        arms: Vec::new(),
        form: Form::Cut,
    }));
    // Insertions first, then outer ranges before inner ones: of two with the same start, the longer
    // one.
    site_list.sort_by_key(|site| {
        (
            site.range.start,
            !site.range.is_empty(),
            usize::MAX - site.range.end,
        )
    });
    let mut printer = Printer {
        source: text,
        out: String::new(),
        arms: Vec::new(),
    };
    printer.print(0..text.len(), &site_list);
    Ok(Switched {
        text: printer.out,
        arms: printer.arms,
        unswitched,
    })
}

/// Byte offsets of the lines of a file.
struct Lines<'a> {
    text: &'a str,
    starts: Vec<usize>,
}

impl<'a> Lines<'a> {
    fn of(text: &'a str) -> Self {
        let ends = text.match_indices('\n').map(|(at, _)| at + 1);
        Self {
            text,
            starts: std::iter::once(0).chain(ends).collect(),
        }
    }

    fn offset(&self, place: Place) -> usize {
        let start = self.starts[place.line - 1];
        let line = &self.text[start..];
        line.char_indices()
            .nth(place.column - 1)
            .map_or(self.text.len(), |(at, _)| start + at)
    }
}

/// A place with mutants: the start of a function's body, or an expression.
struct Site {
    range: Range<usize>,
    /// Number of a mutant and its text for the whole range.
    arms: Vec<(usize, String)>,
    form: Form,
}

#[derive(Clone, Copy, PartialEq)]
enum Form {
    /// Replaces an expression by an expression.
    Expression,
    /// Inserted before a function's first statement.
    Body,
    /// Inserted before `=>`, or before the guard, which is the range.
    Arm { guarded: bool },
    /// The `const` of a function, which must be removed because the function calls `active_mutant`.
    Cut,
}

/// Finds the wanted mutants' places in the syntax.
struct Sites<'a> {
    source: &'a str,
    /// The mutants by byte offset and genre.
    wanted: BTreeMap<(usize, u8), Vec<(usize, String)>>,
    found: Vec<Site>,
    lifted: Vec<Range<usize>>,
    still_const: &'a BTreeSet<String>,
    /// Whether the visitor is inside a function whose body may call `active_mutant`.
    open: bool,
    /// The `const` of that function.
    lift: Option<Range<usize>>,
}

impl Sites<'_> {
    fn take(&mut self, at: usize, genre: Genre) -> Vec<(usize, String)> {
        if !self.open {
            return Vec::new();
        }
        let taken = self.wanted.remove(&(at, genre as u8)).unwrap_or_default();
        if !taken.is_empty() {
            self.lifted.extend(self.lift.take());
        }
        taken
    }

    /// The text of `whole` with its `part` replaced by `by`.
    fn replaced(&self, whole: &Range<usize>, part: &Range<usize>, by: &str) -> String {
        let (ahead, behind) = (whole.start..part.start, part.end..whole.end);
        format!("{} {by} {}", &self.source[ahead], &self.source[behind])
    }

    fn found(&mut self, range: Range<usize>, arms: Vec<(usize, String)>, form: Form) {
        if !arms.is_empty() {
            self.found.push(Site { range, arms, form });
        }
    }

    fn function(&mut self, signature: &syn::Signature, block: &syn::Block) {
        let outer = (self.open, self.lift.take());
        self.open = match &signature.constness {
            None => true,
            Some(constness) => {
                let cut = constness.span().byte_range();
                self.lift = Some(cut);
                !self.still_const.contains(&signature.ident.to_string())
            }
        };
        if let Some(first) = block.stmts.first() {
            let at = first.span().byte_range().start;
            let arms = self.take(at, Genre::FnValue);
            self.found(at..at, arms, Form::Body);
        }
        syn::visit::visit_block(self, block);
        (self.open, self.lift) = outer;
    }

    fn constant(&mut self, visit: impl FnOnce(&mut Self)) {
        let outer = std::mem::replace(&mut self.open, false);
        visit(self);
        self.open = outer;
    }
}

fn has_let(expression: &syn::Expr) -> bool {
    match expression {
        syn::Expr::Let(_) => true,
        syn::Expr::Binary(binary) => has_let(&binary.left) || has_let(&binary.right),
        _ => false,
    }
}

impl<'ast> Visit<'ast> for Sites<'_> {
    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        self.function(&item.sig, &item.block);
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        self.function(&item.sig, &item.block);
    }

    fn visit_trait_item_fn(&mut self, item: &'ast syn::TraitItemFn) {
        if let Some(block) = &item.default {
            self.function(&item.sig, block);
        }
    }

    fn visit_item_const(&mut self, item: &'ast syn::ItemConst) {
        self.constant(|sites| syn::visit::visit_item_const(sites, item));
    }

    fn visit_item_static(&mut self, item: &'ast syn::ItemStatic) {
        self.constant(|sites| syn::visit::visit_item_static(sites, item));
    }

    fn visit_impl_item_const(&mut self, item: &'ast syn::ImplItemConst) {
        self.constant(|sites| syn::visit::visit_impl_item_const(sites, item));
    }

    fn visit_expr_const(&mut self, item: &'ast syn::ExprConst) {
        self.constant(|sites| syn::visit::visit_expr_const(sites, item));
    }

    fn visit_type(&mut self, item: &'ast syn::Type) {
        self.constant(|sites| syn::visit::visit_type(sites, item));
    }

    fn visit_variant(&mut self, item: &'ast syn::Variant) {
        self.constant(|sites| syn::visit::visit_variant(sites, item));
    }

    fn visit_expr_repeat(&mut self, expression: &'ast syn::ExprRepeat) {
        self.visit_expr(&expression.expr);
        self.constant(|sites| sites.visit_expr(&expression.len));
    }

    fn visit_expr_binary(&mut self, expression: &'ast syn::ExprBinary) {
        let whole = expression.span().byte_range();
        let operator = expression.op.span().byte_range();
        if !has_let(&expression.left) && !has_let(&expression.right) {
            let arms = self.take(operator.start, Genre::BinaryOperator).into_iter();
            let arms = arms.map(|(number, by)| (number, self.replaced(&whole, &operator, &by)));
            let arms = arms.collect();
            self.found(whole, arms, Form::Expression);
        }
        syn::visit::visit_expr_binary(self, expression);
    }

    fn visit_expr_unary(&mut self, expression: &'ast syn::ExprUnary) {
        let whole = expression.span().byte_range();
        let operator = expression.op.span().byte_range();
        let arms = self.take(operator.start, Genre::UnaryOperator).into_iter();
        let arms = arms
            .map(|(number, by)| (number, self.replaced(&whole, &operator, &by)))
            .collect();
        self.found(whole, arms, Form::Expression);
        syn::visit::visit_expr_unary(self, expression);
    }

    fn visit_arm(&mut self, arm: &'ast syn::Arm) {
        let arms = self.take(arm.span().byte_range().start, Genre::MatchArm);
        match &arm.guard {
            None => {
                let behind = arm.pat.span().byte_range().end;
                self.found(behind..behind, arms, Form::Arm { guarded: false });
            }
            Some((_, guard)) if !has_let(guard) => {
                let range = guard.span().byte_range();
                self.found(range.clone(), arms, Form::Arm { guarded: true });
                let arms = self.take(range.start, Genre::MatchArmGuard);
                self.found(range, arms, Form::Expression);
            }
            Some(_) => {}
        }
        syn::visit::visit_arm(self, arm);
    }

    fn visit_expr_struct(&mut self, expression: &'ast syn::ExprStruct) {
        if let Some(rest) = &expression.rest {
            let rest = rest.span().byte_range();
            for field in &expression.fields {
                let arms = self.take(field.span().byte_range().start, Genre::StructField);
                let syn::Member::Named(name) = &field.member else {
                    continue;
                };
                let place = format!("({}).{name}", &self.source[rest.clone()]);
                let arms = arms
                    .into_iter()
                    .map(|(number, _)| (number, place.clone()))
                    .collect();
                if field.colon_token.is_some() {
                    self.found(field.expr.span().byte_range(), arms, Form::Expression);
                }
            }
        }
        syn::visit::visit_expr_struct(self, expression);
    }
}

/// Writes the source with its places.
struct Printer<'a> {
    source: &'a str,
    out: String,
    arms: Vec<(Range<usize>, usize)>,
}

impl Printer<'_> {
    /// Prints `range`, which contains `sites`, the outer ones first.
    fn print(&mut self, range: Range<usize>, mut sites: &[Site]) {
        let mut at = range.start;
        while let Some((site, rest)) = sites.split_first() {
            self.out.push_str(&self.source[at..site.range.start]);
            let inner = rest
                .iter()
                .take_while(|other| other.range.start < site.range.end);
            let inner = &rest[..inner.count()];
            self.site(site, inner);
            at = site.range.end;
            sites = &rest[inner.len()..];
        }
        self.out.push_str(&self.source[at..range.end]);
    }

    fn site(&mut self, site: &Site, inner: &[Site]) {
        match site.form {
            Form::Cut => {}
            Form::Expression => {
                self.out
                    .push_str(&format!("(match {} {{", asked(&site.arms)));
                for (number, by) in &site.arms {
                    self.arm(*number, |printer| {
                        printer
                            .out
                            .push_str(&format!(" {}u32 => ({by}),", number + 1));
                    });
                }
                self.out.push_str(" _ => (");
                self.print(site.range.clone(), inner);
                self.out.push_str(") })");
            }
            Form::Body => {
                self.out
                    .push_str(&format!("match {} {{", asked(&site.arms)));
                for (number, by) in &site.arms {
                    self.arm(*number, |printer| {
                        printer
                            .out
                            .push_str(&format!(" {}u32 => return {by},", number + 1));
                    });
                }
                self.out.push_str(" _ => {} } ");
            }
            Form::Arm { guarded } => {
                let (number, _) = site.arms[0];
                self.arm(number, |printer| {
                    let word = if guarded { "" } else { " if " };
                    let (asked, number) = (asked(&site.arms), number + 1);
                    printer
                        .out
                        .push_str(&format!("{word}{asked} != {number}u32"));
                });
                if guarded {
                    self.out.push_str(" && (");
                    self.print(site.range.clone(), inner);
                    self.out.push(')');
                }
            }
        }
    }

    fn arm(&mut self, number: usize, print: impl FnOnce(&mut Self)) {
        let start = self.out.len();
        print(self);
        self.arms.push((start..self.out.len(), number));
    }
}

/// The expression that tests which of these mutants is active.
fn asked(arms: &[(usize, String)]) -> String {
    let numbers: Vec<String> = arms
        .iter()
        .map(|(number, _)| format!("{}u32", number + 1))
        .collect();
    format!("crate::active_mutant(&[{}])", numbers.join(", "))
}
