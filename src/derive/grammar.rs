//! How expressions are written: from text to syntax, by winnow's Pratt parser.

use winnow::ascii::{digit0, digit1, multispace0};
use winnow::combinator::{
    Infix, Prefix, alt, cut_err, delimited, dispatch, eof, expression, fail, opt, separated,
    terminated,
};
use winnow::prelude::*;
use winnow::stream::Stateful;
use winnow::token::{one_of, take_till, take_while};

use super::expression::Binary;

/// An expression as it is written.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Syntax {
    /// A number without sign.
    Number(f64),
    /// A field, without braces.
    Name(String),
    /// A function and its arguments.
    Call(String, Vec<Syntax>),
    /// What follows a minus sign.
    Negate(Box<Syntax>),
    /// An operator between two operands.
    Binary(Binary, Box<Syntax>, Box<Syntax>),
}

// Binding powers: `-x^2` is −(x²), `-x*y` is (−x)·y, `2^-x` is 2^(−x), `x^y^z` is x^(y^z).
const SUM: i64 = 10;
const PRODUCT: i64 = 20;
const SIGN: i64 = 30;
const POWER: i64 = 40;

/// How deep brackets, signs and powers may nest: bounds the stack that parsing takes.
const DEEPEST: usize = 50;

/// Why a text cannot be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fault {
    /// From this byte on it is no expression.
    At(usize),
    /// It nests deeper than [`DEEPEST`].
    TooDeep,
}

/// What is open where parsing stands.
#[derive(Debug, Clone, Copy, Default)]
struct Depth {
    /// Brackets, signs and powers.
    now: usize,
    /// `now` where the innermost bracket opened.
    bracket: usize,
}

type Input<'i> = Stateful<&'i str, Depth>;

/// The syntax of `text`.
pub(super) fn parse(text: &str) -> Result<Syntax, Fault> {
    let mut input = Input { input: text, state: Depth::default() };
    terminated(inner, eof).parse_next(&mut input).map_err(|_| match input.state.now {
        0..=DEEPEST => Fault::At(text.len() - input.input.len()),
        _ => Fault::TooDeep,
    })
}

/// A whole expression, as it stands in brackets or alone.
fn inner(input: &mut Input<'_>) -> ModalResult<Syntax> {
    let outer = input.state;
    deeper(input)?;
    input.state.bracket = input.state.now;
    let syntax = delimited(multispace0, syntax, multispace0).parse_next(input)?;
    input.state = outer;
    Ok(syntax)
}

fn deeper(input: &mut Input<'_>) -> ModalResult<()> {
    input.state.now += 1;
    if input.state.now > DEEPEST { cut_err(fail).parse_next(input) } else { Ok(()) }
}

fn syntax(input: &mut Input<'_>) -> ModalResult<Syntax> {
    expression(operand)
        .prefix(dispatch! {sign;
            '-' => Prefix(SIGN, |_, of| Ok(Syntax::Negate(Box::new(of)))),
            _ => Prefix(SIGN, |_, of| Ok(of)),
        })
        .infix(dispatch! {operator;
            Binary::Add => Infix::Left(SUM, |_, a, b| Ok(pair(Binary::Add, a, b))),
            Binary::Subtract => Infix::Left(SUM, |_, a, b| Ok(pair(Binary::Subtract, a, b))),
            Binary::Multiply => Infix::Left(PRODUCT, |_, a, b| Ok(pair(Binary::Multiply, a, b))),
            Binary::Divide => Infix::Left(PRODUCT, |_, a, b| Ok(pair(Binary::Divide, a, b))),
            Binary::Power => Infix::Right(POWER, |_, a, b| Ok(pair(Binary::Power, a, b))),
            _ => fail,
        })
        .parse_next(input)
}

fn pair(operator: Binary, a: Syntax, b: Syntax) -> Syntax {
    Syntax::Binary(operator, Box::new(a), Box::new(b))
}

fn sign(input: &mut Input<'_>) -> ModalResult<char> {
    let sign = terminated(one_of(['-', '+']), multispace0).parse_next(input)?;
    deeper(input)?;
    Ok(sign)
}

fn operator(input: &mut Input<'_>) -> ModalResult<Binary> {
    let operator = alt((
        '+'.value(Binary::Add),
        '-'.value(Binary::Subtract),
        "**".value(Binary::Power),
        '^'.value(Binary::Power),
        '*'.value(Binary::Multiply),
        '/'.value(Binary::Divide),
    ));
    let operator = delimited(multispace0, operator, multispace0).parse_next(input)?;
    match operator {
        Binary::Power => deeper(input)?,
        // What came before in this bracket is complete.
        _ => input.state.now = input.state.bracket,
    }
    Ok(operator)
}

fn operand(input: &mut Input<'_>) -> ModalResult<Syntax> {
    let bracketed = delimited('(', cut_err(inner), cut_err(')'));
    alt((number, quoted, named, bracketed)).parse_next(input)
}

fn number(input: &mut Input<'_>) -> ModalResult<Syntax> {
    let digits = alt(((digit1, opt(('.', digit0))).void(), ('.', digit1).void()));
    let power = opt((one_of(['e', 'E']), opt(one_of(['+', '-'])), digit1));
    (digits, power)
        .take()
        .verify_map(|text: &str| text.parse().ok().filter(|n: &f64| n.is_finite()))
        .map(Syntax::Number)
        .parse_next(input)
}

fn quoted(input: &mut Input<'_>) -> ModalResult<Syntax> {
    delimited('{', cut_err(take_till(1.., ['{', '}'])), cut_err('}'))
        .map(|name: &str| Syntax::Name(name.to_owned()))
        .parse_next(input)
}

/// A field, or a function if an opening bracket follows.
fn named(input: &mut Input<'_>) -> ModalResult<Syntax> {
    let name = identifier.parse_next(input)?.to_owned();
    let arguments =
        delimited((multispace0, '('), cut_err(separated(1.., inner, ',')), cut_err(')'));
    Ok(match opt(arguments).parse_next(input)? {
        Some(arguments) => Syntax::Call(name, arguments),
        None => Syntax::Name(name),
    })
}

fn identifier<'i>(input: &mut Input<'i>) -> ModalResult<&'i str> {
    let first = one_of(|c: char| c.is_alphabetic() || c == '_');
    (first, take_while(0.., |c: char| c.is_alphanumeric() || c == '_')).take().parse_next(input)
}

/// `name` as an expression takes it: in braces unless it is letters, digits and underscores.
pub(super) fn written(name: &str) -> String {
    match parse(name) {
        Ok(Syntax::Name(plain)) if plain == name => plain,
        _ => format!("{{{name}}}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The expression with every bracket written.
    fn shown(syntax: &Syntax) -> String {
        match syntax {
            Syntax::Number(number) => number.to_string(),
            Syntax::Name(name) => format!("<{name}>"),
            Syntax::Call(name, arguments) => {
                let arguments: Vec<String> = arguments.iter().map(shown).collect();
                format!("{name}({})", arguments.join(","))
            }
            Syntax::Negate(of) => format!("(-{})", shown(of)),
            Syntax::Binary(operator, a, b) => {
                let sign = match operator {
                    Binary::Add => "+",
                    Binary::Subtract => "-",
                    Binary::Multiply => "*",
                    Binary::Divide => "/",
                    _ => "^",
                };
                format!("({}{sign}{})", shown(a), shown(b))
            }
        }
    }

    #[test]
    fn operators_bind_as_in_mathematics() {
        for (text, expected) in [
            ("a+b*c", "(<a>+(<b>*<c>))"),
            ("a-b-c", "((<a>-<b>)-<c>)"),
            ("a/b/c", "((<a>/<b>)/<c>)"),
            ("a^b^c", "(<a>^(<b>^<c>))"),
            ("-a^2", "(-(<a>^2))"),
            ("-a*b", "((-<a>)*<b>)"),
            ("2^-a^2*b", "((2^(-(<a>^2)))*<b>)"),
            ("a--b", "(<a>-(-<b>))"),
            ("+a * - + b", "(<a>*(-<b>))"),
            ("a**2", "(<a>^2)"),
            (" ( a + b ) * c ", "((<a>+<b>)*<c>)"),
            ("max(a, max( b ,c) , 1)", "max(<a>,max(<b>,<c>),1)"),
            ("{x-velocity} - {a (b)}", "(<x-velocity>-<a (b)>)"),
            ("max+maximum*{max}", "(<max>+(<maximum>*<max>))"),
            ("1e-3 + 1.5E+2 + .5 + 2.", "(((0.001+150)+0.5)+2)"),
            ("ρ_1*2", "(<ρ_1>*2)"),
        ] {
            assert_eq!(parse(text).as_ref().map(shown), Ok(expected.to_owned()), "{text}");
        }
    }

    #[test]
    fn what_cannot_be_read_is_pointed_at() {
        for (text, at) in [
            ("", 0),
            ("a+", 2),
            ("a + ) * b", 4),
            ("a b", 2),
            ("(a", 2),
            ("a)", 1),
            ("(a + (b - ))", 10),
            ("max(a,)", 5),
            ("max()", 4),
            ("{a", 2),
            ("{}", 1),
            ("2a", 1),
            ("a ! b", 2),
            ("1e999", 0),
            ("a,b", 1),
        ] {
            assert_eq!(parse(text), Err(Fault::At(at)), "{text}");
        }
    }

    #[test]
    fn what_nests_too_deep_is_refused_and_what_is_long_is_not() {
        let most = DEEPEST - 1;
        let nested = |n: usize| {
            [
                format!("{}a{}", "(".repeat(n), ")".repeat(n)),
                format!("{}a{}", "abs(".repeat(n), ")".repeat(n)),
                format!("{}a", "- ".repeat(n)),
                format!("{}a", "a^".repeat(n)),
                format!("({}a)", "a^-".repeat(n / 2)),
            ]
        };
        for text in nested(most) {
            assert!(parse(&text).is_ok(), "{text}");
        }
        for text in nested(most + 2) {
            assert_eq!(parse(&text), Err(Fault::TooDeep), "{text}");
        }
        for part in ["a^-2*b+", "sqrt(a^2)*", "-(a)/", "max(-a,(b),c^d)-"] {
            assert!(parse(&format!("{}1", part.repeat(100))).is_ok(), "{part}");
        }
    }

    #[test]
    fn names_are_quoted_where_they_must_be() {
        for (name, expected) in [
            ("Density", "Density"),
            ("x-velocity", "{x-velocity}"),
            ("prim.rho", "{prim.rho}"),
            ("4he", "{4he}"),
            ("he4", "he4"),
        ] {
            assert_eq!(written(name), expected);
            assert_eq!(parse(expected), Ok(Syntax::Name(name.into())));
        }
    }
}
