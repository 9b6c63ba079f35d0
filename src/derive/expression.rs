//! An expression over fields: what is computed, whatever it is computed of.

use super::grammar::{self, Fault, Syntax};
use crate::spelling::nearest_first;

/// Longest expression, bytes: bounds how many operations can wait for each other.
const LONGEST: usize = 1000;

/// An operation on one value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unary {
    Negate,
    Abs,
    Sqrt,
    Exp,
    /// The natural logarithm.
    Log,
    Log10,
}

/// An operation on two values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Binary {
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Min,
    Max,
}

/// Functions of one argument.
const FUNCTIONS: [(&str, Unary); 5] = [
    ("abs", Unary::Abs),
    ("sqrt", Unary::Sqrt),
    ("exp", Unary::Exp),
    ("log", Unary::Log),
    ("log10", Unary::Log10),
];
/// Functions of two or more.
const EXTREMA: [(&str, Binary); 2] = [("min", Binary::Min), ("max", Binary::Max)];

/// What an expression can be computed of: cells, or units.
pub(super) trait Algebra {
    /// What is computed with.
    type Value;
    /// Why an operation may fail.
    type Error;
    /// A number that the expression states.
    fn number(&self, number: f64) -> Self::Value;
    /// The operand of number `index` in [`Expression::names`].
    fn operand(&self, index: usize) -> Self::Value;
    /// An operation on one value.
    fn unary(&self, operation: Unary, of: Self::Value) -> Result<Self::Value, Self::Error>;
    /// An operation on two values.
    fn binary(
        &self,
        operation: Binary,
        a: Self::Value,
        b: Self::Value,
    ) -> Result<Self::Value, Self::Error>;
}

/// A parsed expression.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Expression {
    names: Vec<String>,
    root: Node,
}

#[derive(Debug, Clone, PartialEq)]
enum Node {
    Number(f64),
    Operand(usize),
    Unary(Unary, Box<Node>),
    Binary(Binary, Box<Node>, Box<Node>),
}

impl Expression {
    /// Parses `text`.
    ///
    /// # Errors
    /// One line that says what is wrong and where.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        if text.len() > LONGEST {
            return Err(format!("it is longer than {LONGEST} bytes"));
        }
        let syntax = grammar::parse(text).map_err(|fault| match fault {
            Fault::At(byte) => unreadable(text, byte),
            Fault::TooDeep => "it nests brackets, signs and powers too deep".into(),
        })?;
        let mut names = Vec::new();
        let root = resolve(&syntax, &mut names)?;
        Ok(Self { names, root })
    }

    /// The fields that it names, each once, in the order of their first use.
    pub(super) fn names(&self) -> &[String] {
        &self.names
    }

    /// Whether it is no more than a field's name.
    pub(super) fn is_name(&self) -> bool {
        matches!(self.root, Node::Operand(_))
    }

    /// Its value in `algebra`.
    ///
    /// # Errors
    /// What the algebra's operations refuse.
    pub(super) fn evaluate<A: Algebra>(&self, algebra: &A) -> Result<A::Value, A::Error> {
        self.root.evaluate(algebra)
    }
}

impl Node {
    fn evaluate<A: Algebra>(&self, algebra: &A) -> Result<A::Value, A::Error> {
        match self {
            Self::Number(number) => Ok(algebra.number(*number)),
            Self::Operand(index) => Ok(algebra.operand(*index)),
            Self::Unary(operation, of) => algebra.unary(*operation, of.evaluate(algebra)?),
            Self::Binary(operation, a, b) => {
                algebra.binary(*operation, a.evaluate(algebra)?, b.evaluate(algebra)?)
            }
        }
    }
}

fn unreadable(text: &str, at: usize) -> String {
    let (before, rest) = text.split_at_checked(at).unwrap_or((text, ""));
    if rest.trim().is_empty() {
        let is_open = before.rfind('{') > before.rfind('}');
        let due = if is_open { "`}`" } else { "a number, a field, a function or `)`" };
        return format!("it ends where {due} is due");
    }
    let shown: String = rest.chars().take(20).collect();
    let place = before.chars().count() + 1;
    format!("it cannot be read from character {place} on: `{}`", shown.escape_debug())
}

/// The node of `syntax`; adds the names that it has to `names`.
fn resolve(syntax: &Syntax, names: &mut Vec<String>) -> Result<Node, String> {
    Ok(match syntax {
        Syntax::Number(number) => Node::Number(*number),
        Syntax::Name(name) => Node::Operand(index_of(name, names)),
        Syntax::Negate(of) => Node::Unary(Unary::Negate, Box::new(resolve(of, names)?)),
        Syntax::Binary(operation, a, b) => {
            let [a, b] = [resolve(a, names)?, resolve(b, names)?];
            Node::Binary(*operation, Box::new(a), Box::new(b))
        }
        Syntax::Call(name, arguments) => {
            let arguments = arguments.iter().map(|of| resolve(of, names));
            call(name, arguments.collect::<Result<_, _>>()?)?
        }
    })
}

fn index_of(name: &str, names: &mut Vec<String>) -> usize {
    names.iter().position(|known| known == name).unwrap_or_else(|| {
        names.push(name.to_owned());
        names.len() - 1
    })
}

fn call(name: &str, arguments: Vec<Node>) -> Result<Node, String> {
    let count = arguments.len();
    let takes = |what: &str| format!("`{name}` takes {what}, not {count}");
    if let Some((_, operation)) = FUNCTIONS.iter().find(|(known, _)| *known == name) {
        let [of] = <[Node; 1]>::try_from(arguments).map_err(|_| takes("one argument"))?;
        return Ok(Node::Unary(*operation, Box::new(of)));
    }
    if let Some((_, operation)) = EXTREMA.iter().find(|(known, _)| *known == name) {
        let both = |a, b| Node::Binary(*operation, Box::new(a), Box::new(b));
        let joined = arguments.into_iter().reduce(both).filter(|_| count > 1);
        return joined.ok_or_else(|| takes("two arguments or more"));
    }
    let known = FUNCTIONS.iter().map(|(known, _)| *known).chain(EXTREMA.map(|(known, _)| known));
    let known = nearest_first(name, known).join(", ");
    Err(format!("no function `{}`: there are {known}", name.escape_debug()))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn refused(text: &str) -> String {
        Expression::parse(text).unwrap_err()
    }

    #[test]
    fn names_are_listed_once_each() {
        let expression = Expression::parse("{x-velocity}^2 + Density*{x-velocity} - 3").unwrap();
        assert_eq!(expression.names(), ["x-velocity", "Density"]);
        assert!(!expression.is_name());
        assert!(Expression::parse(" ({x-velocity})").unwrap().is_name());
        assert!(Expression::parse("2^3").unwrap().names().is_empty());
    }

    #[test]
    fn faults_are_told_with_their_place() {
        assert!(refused("a + ").contains("it ends where a number"));
        assert!(refused("a + {phi").contains("it ends where `}` is due"));
        assert!(refused("ä + )").contains("character 5 on: `)`"));
        assert!(refused("a ! b\n").contains("character 3 on: `! b\\n`"));
        assert!(refused("squrt(a)").contains("no function `squrt`: there are sqrt, abs"));
        assert!(refused("sqrt(a, b)").contains("`sqrt` takes one argument, not 2"));
        assert!(refused("max(a)").contains("`max` takes two arguments or more, not 1"));
        assert!(refused(&"a+".repeat(501)).contains("longer than 1000 bytes"));
    }

    /// The deepest that the longest text can nest, on half of a thread's usual stack.
    #[test]
    fn no_text_takes_more_than_a_thread_has() {
        let small = std::thread::Builder::new().stack_size(1 << 20);
        let parse_all = || {
            let half = LONGEST / 2 - 1;
            for text in [
                format!("{}a", "-".repeat(LONGEST - 1)),
                format!("{}a{}", "(".repeat(half), ")".repeat(half)),
                "(".repeat(LONGEST),
                "abs(".repeat(LONGEST / 4),
                format!("{}a{}", "abs(".repeat(LONGEST / 5 - 1), ")".repeat(LONGEST / 5 - 1)),
                format!("{}a", "a^".repeat(half)),
                format!("{}a", "a+".repeat(half)),
                format!("max({}a)", "a,".repeat(half - 3)),
            ] {
                if let Ok(expression) = Expression::parse(&text) {
                    assert!(matches!(expression.evaluate(&Count), Ok(count) if count > 0));
                }
            }
        };
        small.spawn(parse_all).unwrap().join().unwrap();
    }

    /// How many numbers and operands there are.
    struct Count;

    impl Algebra for Count {
        type Value = u32;
        type Error = std::convert::Infallible;

        fn number(&self, _: f64) -> u32 {
            1
        }

        fn operand(&self, _: usize) -> u32 {
            1
        }

        fn unary(&self, _: Unary, of: u32) -> Result<u32, Self::Error> {
            Ok(of)
        }

        fn binary(&self, _: Binary, a: u32, b: u32) -> Result<u32, Self::Error> {
            Ok(a + b)
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn any_bytes_are_parsed_or_refused_in_one_line(
            bytes in prop::collection::vec(any::<u8>(), 0..200)
        ) {
            let parsed = Expression::parse(&String::from_utf8_lossy(&bytes));
            prop_assert!(parsed.err().is_none_or(|reason| !reason.contains(char::is_control)));
        }

        #[test]
        fn what_looks_like_an_expression_too(
            parts in prop::collection::vec(prop::sample::select(vec![
                "a", "{b c}", "{", "}", "(", ")", "max", "sqrt", "log10", ",", "+", "-", "*", "/",
                "^", "**", "1", "2.5e3", "e", ".", " ", "\t", "é", "\u{0}",
            ]), 0..60)
        ) {
            let parsed = Expression::parse(&parts.concat());
            prop_assert!(parsed.as_ref().err().is_none_or(|r| !r.contains(char::is_control)));
            if let Ok(expression) = parsed {
                prop_assert!(matches!(expression.evaluate(&Count), Ok(count) if count > 0));
            }
        }
    }
}
