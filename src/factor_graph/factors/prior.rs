//! Variables that are known beforehand.

use super::motion::{pose_error, pose3_error};
use super::{Factor, Jacobian};
use crate::factor_graph::{GraphError, Values, VariableId};
use crate::geometry::{Pose, Pose3};
use nalgebra::{Point2, Point3};

/// A variable is known beforehand, or several together.
#[derive(Clone, Debug, PartialEq)]
pub struct Prior {
    variables: Vec<VariableId>,
    means: Vec<Mean>,
}

#[derive(Clone, Debug, PartialEq)]
enum Mean {
    Pose(Pose),
    Point(Point2<f64>),
    Pose3(Pose3),
    Point3(Point3<f64>),
    Vector(Vec<f64>),
}

impl Mean {
    fn dimension(&self) -> usize {
        match self {
            Self::Pose(_) => 3,
            Self::Point(_) => 2,
            Self::Pose3(_) => 6,
            Self::Point3(_) => 3,
            Self::Vector(mean) => mean.len(),
        }
    }
}

impl Prior {
    fn one(variable: VariableId, mean: Mean) -> Self {
        Self { variables: vec![variable], means: vec![mean] }
    }

    /// The residuals of several priors one after the other: noise may tie them together.
    pub fn joint(priors: impl IntoIterator<Item = Self>) -> Self {
        let mut joint = Self { variables: Vec::new(), means: Vec::new() };
        for Self { variables, means } in priors {
            joint.variables.extend(variables);
            joint.means.extend(means);
        }
        joint
    }

    /// e = log(mean⁻¹ · pose): (forward, sideways \[m\], turn \[rad\]) in the frame of the mean.
    pub fn pose(pose: VariableId, mean: Pose) -> Self {
        Self::one(pose, Mean::Pose(mean))
    }

    /// e = point - mean \[m\].
    pub fn point(point: VariableId, mean: Point2<f64>) -> Self {
        Self::one(point, Mean::Point(mean))
    }

    /// e = log(mean⁻¹ · pose): (translation \[m\], rotation vector \[rad\]) in the frame of the mean.
    pub fn pose3(pose: VariableId, mean: Pose3) -> Self {
        Self::one(pose, Mean::Pose3(mean))
    }

    /// e = point - mean \[m\].
    pub fn point3(point: VariableId, mean: Point3<f64>) -> Self {
        Self::one(point, Mean::Point3(mean))
    }

    /// e = vector - mean.
    pub fn vector(vector: VariableId, mean: &[f64]) -> Self {
        Self::one(vector, Mean::Vector(mean.to_vec()))
    }
}

impl Factor for Prior {
    fn variables(&self) -> &[VariableId] {
        &self.variables
    }

    fn dimension(&self) -> usize {
        self.means.iter().map(Mean::dimension).sum()
    }

    fn evaluate(
        &self,
        values: &Values,
        residual: &mut [f64],
        mut jacobian: Option<&mut Jacobian<'_>>,
    ) -> Result<(), GraphError> {
        let mut first = 0;
        for (variable, mean) in self.variables.iter().zip(&self.means) {
            let dimension = mean.dimension();
            let residual = &mut residual[first..first + dimension];
            let mut jacobian = jacobian.as_mut().map(|all| all.view_mut((first, first), (dimension, dimension)));
            first += dimension;
            match mean {
                Mean::Pose(mean) => {
                    let (error, derivative) = pose_error(*mean, values.pose(*variable)?);
                    residual.copy_from_slice(error.as_slice());
                    if let Some(jacobian) = &mut jacobian {
                        jacobian.copy_from(&derivative);
                    }
                    continue;
                }
                Mean::Pose3(mean) => {
                    let (error, derivative) = pose3_error(*mean, values.pose3(*variable)?);
                    residual.copy_from_slice(error.as_slice());
                    if let Some(jacobian) = &mut jacobian {
                        jacobian.copy_from(&derivative);
                    }
                    continue;
                }
                Mean::Point(mean) => residual.copy_from_slice((values.point(*variable)? - mean).as_slice()),
                Mean::Point3(mean) => residual.copy_from_slice((values.point3(*variable)? - mean).as_slice()),
                Mean::Vector(mean) => {
                    let vector = values.vector_of(*variable, mean.len())?;
                    residual.iter_mut().zip(vector).zip(mean).for_each(|((error, value), mean)| *error = value - mean);
                }
            }
            if let Some(jacobian) = &mut jacobian {
                jacobian.fill_with_identity();
            }
        }
        Ok(())
    }
}
