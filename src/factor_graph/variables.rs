//! What is estimated: variables, their values, and the steps between values.
//!
//! A variable has `dimension` degrees of freedom. A step is a vector of as many numbers, in the tangent space at the
//! variable's present value; the steps of all variables one after the other make the tangent vector of the graph.

use super::{GraphError, Prior};
use crate::geometry::{Pose, Pose3};
use nalgebra::{Point2, Point3, Quaternion, Unit, Vector3, Vector6};
use std::ops::Range;

/// Names a variable of [`Values`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct VariableId(u32);

impl VariableId {
    /// Its number, counted from 0 in the order in which variables were added.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// What a variable is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A pose of the plane, SE(2). A step (forward, sideways \[m\], turn \[rad\]) is taken in the frame of the pose:
    /// x ⊞ d = x · exp(d).
    Pose,
    /// A point of the plane \[m\]. Steps add.
    Point,
    /// A pose of space, SE(3). A step (translation \[m\], rotation vector \[rad\]) is taken in the frame of the pose:
    /// x ⊞ d = x · exp(d).
    Pose3,
    /// A point of space \[m\]. Steps add.
    Point3,
    /// A vector of this dimension; an update is added.
    Vector(usize),
}

impl Kind {
    /// Degrees of freedom.
    pub fn dimension(self) -> usize {
        match self {
            Self::Pose => 3,
            Self::Point => 2,
            Self::Pose3 => 6,
            Self::Point3 => 3,
            Self::Vector(length) => length,
        }
    }

    /// How many numbers its value has.
    fn numbers(self) -> usize {
        match self {
            // A position and a unit quaternion.
            Self::Pose3 => 7,
            other => other.dimension(),
        }
    }
}

/// A variable's place.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Variable {
    kind: Kind,
    /// Where its numbers start.
    numbers: usize,
    /// Where its step starts in the tangent vector.
    tangent: usize,
}

impl Variable {
    fn numbers(self) -> Range<usize> {
        self.numbers..self.numbers + self.kind.numbers()
    }

    fn tangent(self) -> Range<usize> {
        self.tangent..self.tangent + self.kind.dimension()
    }
}

/// The values of all variables.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Values {
    variables: Vec<Variable>,
    numbers: Vec<f64>,
    dimension: usize,
}

impl Values {
    /// No variables.
    pub fn new() -> Self {
        Self::default()
    }

    /// A new variable: a pose.
    pub fn add_pose(&mut self, pose: Pose) -> VariableId {
        self.add(Kind::Pose, &[pose.x, pose.y, pose.heading])
    }

    /// A new variable: a point \[m\].
    pub fn add_point(&mut self, point: Point2<f64>) -> VariableId {
        self.add(Kind::Point, &[point.x, point.y])
    }

    /// A new variable: a pose of space.
    pub fn add_pose3(&mut self, pose: Pose3) -> VariableId {
        self.add(Kind::Pose3, &numbers_of(pose))
    }

    /// A new variable: a point of space \[m\].
    pub fn add_point3(&mut self, point: Point3<f64>) -> VariableId {
        self.add(Kind::Point3, point.coords.as_slice())
    }

    /// A new variable: a few numbers, such as a velocity or a calibration.
    pub fn add_vector(&mut self, numbers: &[f64]) -> VariableId {
        self.add(Kind::Vector(numbers.len()), numbers)
    }

    fn add(&mut self, kind: Kind, numbers: &[f64]) -> VariableId {
        let id = VariableId(self.variables.len() as u32);
        self.variables.push(Variable { kind, numbers: self.numbers.len(), tangent: self.dimension });
        self.numbers.extend_from_slice(numbers);
        self.dimension += kind.dimension();
        id
    }

    /// How many variables there are.
    pub fn len(&self) -> usize {
        self.variables.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.variables.is_empty()
    }

    /// Degrees of freedom of all variables together: the length of a step.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// All variables, in the order in which they were added.
    pub fn ids(&self) -> impl Iterator<Item = VariableId> + use<> {
        (0..self.variables.len() as u32).map(VariableId)
    }

    fn variable(&self, id: VariableId) -> Result<Variable, GraphError> {
        self.variables.get(id.index()).copied().ok_or(GraphError::Unknown { variable: id })
    }

    /// What a variable is.
    ///
    /// # Errors
    /// There is no such variable.
    pub fn kind(&self, id: VariableId) -> Result<Kind, GraphError> {
        Ok(self.variable(id)?.kind)
    }

    /// Where the step of a variable lies in the tangent vector.
    ///
    /// # Errors
    /// There is no such variable.
    pub fn tangent(&self, id: VariableId) -> Result<Range<usize>, GraphError> {
        Ok(self.variable(id)?.tangent())
    }

    /// The numbers of a variable that `is` what is wanted.
    fn numbers(
        &self,
        id: VariableId,
        wanted: &'static str,
        is: impl Fn(Kind) -> bool,
    ) -> Result<Range<usize>, GraphError> {
        let variable = self.variable(id)?;
        let kind = variable.kind;
        if is(kind) { Ok(variable.numbers()) } else { Err(GraphError::Kind { variable: id, kind, wanted }) }
    }

    /// The value of a pose.
    ///
    /// # Errors
    /// The variable is no pose.
    pub fn pose(&self, id: VariableId) -> Result<Pose, GraphError> {
        let numbers = &self.numbers[self.numbers(id, "a pose of the plane", |kind| kind == Kind::Pose)?];
        Ok(Pose { x: numbers[0], y: numbers[1], heading: numbers[2] })
    }

    /// The value of a point \[m\].
    ///
    /// # Errors
    /// The variable is no point.
    pub fn point(&self, id: VariableId) -> Result<Point2<f64>, GraphError> {
        let numbers = &self.numbers[self.numbers(id, "a point of the plane", |kind| kind == Kind::Point)?];
        Ok(Point2::new(numbers[0], numbers[1]))
    }

    /// The value of a pose of space.
    ///
    /// # Errors
    /// The variable is no pose of space.
    pub fn pose3(&self, id: VariableId) -> Result<Pose3, GraphError> {
        Ok(pose_of(&self.numbers[self.numbers(id, "a pose of space", |kind| kind == Kind::Pose3)?]))
    }

    /// The value of a point of space \[m\].
    ///
    /// # Errors
    /// The variable is no point of space.
    pub fn point3(&self, id: VariableId) -> Result<Point3<f64>, GraphError> {
        let numbers = &self.numbers[self.numbers(id, "a point of space", |kind| kind == Kind::Point3)?];
        Ok(Point3::new(numbers[0], numbers[1], numbers[2]))
    }

    /// The numbers of a vector.
    ///
    /// # Errors
    /// The variable is no vector.
    pub fn vector(&self, id: VariableId) -> Result<&[f64], GraphError> {
        Ok(&self.numbers[self.numbers(id, "a vector", |kind| matches!(kind, Kind::Vector(_)))?])
    }

    /// The numbers of a vector of that length.
    pub(super) fn vector_of(&self, id: VariableId, length: usize) -> Result<&[f64], GraphError> {
        let vector = self.vector(id)?;
        if vector.len() == length {
            Ok(vector)
        } else {
            Err(GraphError::Length { wanted: length, found: vector.len() })
        }
    }

    /// Gives a pose another value.
    ///
    /// # Errors
    /// The variable is no pose.
    pub fn set_pose(&mut self, id: VariableId, pose: Pose) -> Result<(), GraphError> {
        let range = self.numbers(id, "a pose of the plane", |kind| kind == Kind::Pose)?;
        self.numbers[range].copy_from_slice(&[pose.x, pose.y, pose.heading]);
        Ok(())
    }

    /// Gives a point another value \[m\].
    ///
    /// # Errors
    /// The variable is no point.
    pub fn set_point(&mut self, id: VariableId, point: Point2<f64>) -> Result<(), GraphError> {
        let range = self.numbers(id, "a point of the plane", |kind| kind == Kind::Point)?;
        self.numbers[range].copy_from_slice(&[point.x, point.y]);
        Ok(())
    }

    /// Gives a pose of space another value.
    ///
    /// # Errors
    /// The variable is no pose of space.
    pub fn set_pose3(&mut self, id: VariableId, pose: Pose3) -> Result<(), GraphError> {
        let range = self.numbers(id, "a pose of space", |kind| kind == Kind::Pose3)?;
        self.numbers[range].copy_from_slice(&numbers_of(pose));
        Ok(())
    }

    /// Gives a vector other numbers.
    ///
    /// # Errors
    /// The variable is no vector of that length.
    pub fn set_vector(&mut self, id: VariableId, numbers: &[f64]) -> Result<(), GraphError> {
        let range = self.numbers(id, "a vector of that length", |kind| kind == Kind::Vector(numbers.len()))?;
        self.numbers[range].copy_from_slice(numbers);
        Ok(())
    }

    /// All variables, moved by a step.
    ///
    /// # Errors
    /// The step has another length than the tangent vector.
    pub fn retract(&self, step: &[f64]) -> Result<Self, GraphError> {
        if step.len() != self.dimension() {
            return Err(GraphError::Length { wanted: self.dimension(), found: step.len() });
        }
        let mut moved = self.clone();
        for variable in &self.variables {
            let (numbers, step) = (&mut moved.numbers[variable.numbers()], &step[variable.tangent()]);
            match variable.kind {
                Kind::Pose => {
                    let pose = Pose { x: numbers[0], y: numbers[1], heading: numbers[2] };
                    let pose = pose * Pose::exp(Vector3::new(step[0], step[1], step[2]));
                    numbers.copy_from_slice(&[pose.x, pose.y, pose.heading]);
                }
                Kind::Pose3 => {
                    let pose = pose_of(numbers) * Pose3::exp(Vector6::from_column_slice(step));
                    numbers.copy_from_slice(&numbers_of(pose));
                }
                Kind::Point | Kind::Point3 | Kind::Vector(_) => {
                    numbers.iter_mut().zip(step).for_each(|(number, step)| *number += step)
                }
            }
        }
        Ok(moved)
    }
}

/// A pose or a point, of the plane or of space: what is generic in it reads and writes variables so.
pub trait Value: Copy {
    /// A new variable of this value.
    fn add_to(self, values: &mut Values) -> VariableId;

    /// The value of a variable.
    ///
    /// # Errors
    /// The variable is something else.
    fn read(values: &Values, id: VariableId) -> Result<Self, GraphError>;

    /// The variable is known beforehand to be this.
    fn prior(self, id: VariableId) -> Prior;
}

macro_rules! value {
    ($type:ty, $add:ident, $read:ident) => {
        impl Value for $type {
            fn add_to(self, values: &mut Values) -> VariableId {
                values.$add(self)
            }

            fn read(values: &Values, id: VariableId) -> Result<Self, GraphError> {
                values.$read(id)
            }

            fn prior(self, id: VariableId) -> Prior {
                Prior::$read(id, self)
            }
        }
    };
}

value!(Pose, add_pose, pose);
value!(Pose3, add_pose3, pose3);
value!(Point2<f64>, add_point, point);
value!(Point3<f64>, add_point3, point3);

/// A pose of space as its seven numbers.
fn numbers_of(pose: Pose3) -> [f64; 7] {
    let (at, q) = (pose.position, pose.rotation.coords);
    [at.x, at.y, at.z, q.x, q.y, q.z, q.w]
}

fn pose_of(numbers: &[f64]) -> Pose3 {
    let position = Point3::new(numbers[0], numbers[1], numbers[2]);
    // Rounding of many products would let its norm drift.
    let rotation = Unit::new_normalize(Quaternion::new(numbers[6], numbers[3], numbers[4], numbers[5]));
    Pose3 { position, rotation }
}
