//! A variable that is known beforehand.

use super::motion::{pose_error, pose3_error};
use super::{Factor, Jacobian};
use crate::factor_graph::{GraphError, Values, VariableId};
use crate::geometry::{Pose, Pose3};
use nalgebra::{Point2, Point3};

/// A variable is known beforehand.
#[derive(Clone, Debug, PartialEq)]
pub struct Prior {
    variable: [VariableId; 1],
    mean: Mean,
}

#[derive(Clone, Debug, PartialEq)]
enum Mean {
    Pose(Pose),
    Point(Point2<f64>),
    Pose3(Pose3),
    Point3(Point3<f64>),
    Vector(Vec<f64>),
}

impl Prior {
    /// e = log(mean⁻¹ · pose): (forward, sideways \[m\], turn \[rad\]) in the frame of the mean.
    pub fn pose(pose: VariableId, mean: Pose) -> Self {
        Self { variable: [pose], mean: Mean::Pose(mean) }
    }

    /// e = point - mean \[m\].
    pub fn point(point: VariableId, mean: Point2<f64>) -> Self {
        Self { variable: [point], mean: Mean::Point(mean) }
    }

    /// e = log(mean⁻¹ · pose): (translation \[m\], rotation vector \[rad\]) in the frame of the mean.
    pub fn pose3(pose: VariableId, mean: Pose3) -> Self {
        Self { variable: [pose], mean: Mean::Pose3(mean) }
    }

    /// e = point - mean \[m\].
    pub fn point3(point: VariableId, mean: Point3<f64>) -> Self {
        Self { variable: [point], mean: Mean::Point3(mean) }
    }

    /// e = vector - mean.
    pub fn vector(vector: VariableId, mean: &[f64]) -> Self {
        Self { variable: [vector], mean: Mean::Vector(mean.to_vec()) }
    }
}

impl Factor for Prior {
    fn variables(&self) -> &[VariableId] {
        &self.variable
    }

    fn dimension(&self) -> usize {
        match &self.mean {
            Mean::Pose(_) => 3,
            Mean::Point(_) => 2,
            Mean::Pose3(_) => 6,
            Mean::Point3(_) => 3,
            Mean::Vector(mean) => mean.len(),
        }
    }

    fn evaluate(
        &self,
        values: &Values,
        residual: &mut [f64],
        jacobian: Option<&mut Jacobian<'_>>,
    ) -> Result<(), GraphError> {
        let [variable] = self.variable;
        match &self.mean {
            Mean::Pose(mean) => {
                let (error, derivative) = pose_error(*mean, values.pose(variable)?);
                residual.copy_from_slice(error.as_slice());
                if let Some(jacobian) = jacobian {
                    jacobian.copy_from(&derivative);
                }
                return Ok(());
            }
            Mean::Pose3(mean) => {
                let (error, derivative) = pose3_error(*mean, values.pose3(variable)?);
                residual.copy_from_slice(error.as_slice());
                if let Some(jacobian) = jacobian {
                    jacobian.copy_from(&derivative);
                }
                return Ok(());
            }
            Mean::Point(mean) => residual.copy_from_slice((values.point(variable)? - mean).as_slice()),
            Mean::Point3(mean) => residual.copy_from_slice((values.point3(variable)? - mean).as_slice()),
            Mean::Vector(mean) => {
                let vector = values.vector_of(variable, mean.len())?;
                residual.iter_mut().zip(vector).zip(mean).for_each(|((error, value), mean)| *error = value - mean);
            }
        }
        if let Some(jacobian) = jacobian {
            jacobian.fill_with_identity();
        }
        Ok(())
    }
}
