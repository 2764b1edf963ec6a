//! The node: its topics, their types and qualities of service.

use super::input::{Raw, RawReader, Shared, forward};
use super::messages::{Diagnostics, Empty, Markers, OccupancyGrid, PoseWithCovariance, Transforms};
use ros2_client::names::NameError;
use ros2_client::qos::{Durability, History, QosProfile, Reliability, WhenFull};
use ros2_client::{Context, ContextOptions, MessageTypeName, Name, NodeName, NodeOptions, Publisher, Subscription};
use rustdds::{RTPSEntity as _, Topic};
use serde::Serialize;
use std::fmt::Display;
use std::io::PipeReader;
use std::sync::Arc;

/// Names that the user may choose.
#[derive(Clone, Debug)]
pub struct Names {
    /// Domain of DDS, 0 to 232.
    pub domain: u16,
    /// Name space of the node and of its topics, but for `/tf`, `/tf_static` and `/diagnostics`: `/`, or `/robot1`.
    pub namespace: String,
    /// Topics of the scans: of several lasers of one robot, which take turns.
    pub scan: Vec<String>,
    /// Topic of the odometry messages.
    pub odometry: String,
    /// Topics of inertial sensors.
    pub imu: Vec<String>,
    /// Frame of the map.
    pub map_frame: String,
}

impl Names {
    /// A topic with its name space.
    pub fn absolute(&self, topic: &str) -> String {
        let space = self.namespace.trim_end_matches('/');
        if topic.starts_with('/') { topic.to_owned() } else { format!("{space}/{topic}") }
    }
}

/// Why there is no node.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LiveError {
    /// DDS does not start, or makes no topic.
    #[error("ROS 2 over DDS, domain {domain}: {reason}")]
    Dds {
        /// The domain.
        domain: u16,
        /// What DDS said.
        reason: String,
    },
    /// A name that ROS 2 does not allow.
    #[error(
        "`{0}` is no name of ROS 2: these have letters, digits and single underscores in parts with a slash between them, none of \
         which begins with a digit"
    )]
    Name(String),
    /// The system gives no pipe or thread.
    #[error("messages cannot be received: {0}")]
    Pipe(#[from] std::io::Error),
}

/// As tf2 has it for transforms.
const RELIABLE: QosProfile = QosProfile::subscription_default()
    .reliability(Reliability::Reliable { when_full: WhenFull::Fail })
    .history(History::KeepLast { depth: 100 });
/// Who subscribes later gets the last message too.
const LATCHED: QosProfile = RELIABLE.durability(Durability::TransientLocal).history(History::KeepLast { depth: 1 });
/// Sensor data, from reliable publishers and others: what is lost is lost.
const SENSOR: QosProfile = QosProfile::subscription_default().history(History::KeepLast { depth: 100 });

const TRANSFORMS: [&str; 2] = ["tf2_msgs", "TFMessage"];
const POSE: [&str; 2] = ["geometry_msgs", "PoseWithCovarianceStamped"];

/// What the node publishes.
pub(super) struct Publishers {
    pub transforms: Publisher<Transforms>,
    pub map: Publisher<OccupancyGrid>,
    pub pose: Publisher<PoseWithCovariance>,
    pub walls: Publisher<Markers>,
    pub diagnostics: Publisher<Diagnostics>,
}

/// The node.
pub struct Node {
    node: ros2_client::Node,
    context: Context,
    pub(super) names: Names,
    pub(super) publishers: Arc<Publishers>,
    pub(super) shared: Shared,
}

/// A node that is being made.
struct Maker<'a> {
    node: &'a mut ros2_client::Node,
    names: &'a Names,
}

impl Names {
    fn failed(&self, error: impl Display) -> LiveError {
        LiveError::Dds { domain: self.domain, reason: error.to_string() }
    }
}

/// The error of a name.
fn wrong(name: &str) -> impl Fn(NameError) -> LiveError + '_ {
    |_| LiveError::Name(name.to_owned())
}

impl Maker<'_> {
    fn topic(&self, name: &str, [package, message]: [&str; 2], qos: &QosProfile) -> Result<Topic, LiveError> {
        let name = self.names.absolute(name);
        let (space, base) = name.rsplit_once('/').unwrap_or(("", &name));
        let parsed = Name::new(if space.is_empty() { "/" } else { space }, base).map_err(wrong(&name))?;
        let topic = self.node.create_topic(&parsed, MessageTypeName::new(package, message), qos);
        topic.map_err(|error| self.names.failed(error))
    }

    fn publisher<M: Serialize>(
        &mut self,
        name: &str,
        message_type: [&str; 2],
        qos: &QosProfile,
    ) -> Result<Publisher<M>, LiveError> {
        let topic = self.topic(name, message_type, qos)?;
        self.node.create_publisher(&topic, None).map_err(|error| self.names.failed(error))
    }

    fn subscription<M: 'static>(&mut self, name: &str, message_type: [&str; 2]) -> Result<Subscription<M>, LiveError> {
        let topic = self.topic(name, message_type, &RELIABLE)?;
        self.node.create_subscription(&topic, None).map_err(|error| self.names.failed(error))
    }
}

impl Node {
    /// The node, whose topics can be seen from now on.
    ///
    /// # Errors
    /// DDS does not start, or a name is none.
    pub fn new(names: Names) -> Result<Self, LiveError> {
        let options = ContextOptions::new().domain_id(names.domain);
        let context = Context::with_options(options).map_err(|error| names.failed(error))?;
        let name = NodeName::new(&names.namespace, "ipslam").map_err(wrong(&names.namespace))?;
        let options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
        let mut node = context.new_node(name, options).map_err(|error| names.failed(error))?;
        let mut maker = Maker { node: &mut node, names: &names };
        let publishers = Publishers {
            transforms: maker.publisher("/tf", TRANSFORMS, &RELIABLE)?,
            map: maker.publisher("map", ["nav_msgs", "OccupancyGrid"], &LATCHED)?,
            pose: maker.publisher("pose", POSE, &RELIABLE)?,
            walls: maker.publisher("walls", ["visualization_msgs", "MarkerArray"], &LATCHED)?,
            diagnostics: maker.publisher("/diagnostics", ["diagnostic_msgs", "DiagnosticArray"], &RELIABLE)?,
        };
        Ok(Self { node, context, names, publishers: Arc::new(publishers), shared: Shared::default() })
    }

    /// Subscribes to the robot's topics: a bag in MCAP of what comes from now on.
    ///
    /// # Errors
    /// A name is none, or a topic cannot be made.
    pub fn subscribe(&mut self) -> Result<PipeReader, LiveError> {
        let names = &self.names;
        let scans = names.scan.iter().map(|name| (name.as_str(), ["sensor_msgs", "LaserScan"], SENSOR));
        let of_robot = [
            (names.odometry.as_str(), ["nav_msgs", "Odometry"], SENSOR),
            ("/tf", TRANSFORMS, RELIABLE),
            ("/tf_static", TRANSFORMS, LATCHED.history(History::KeepLast { depth: 100 })),
        ];
        let mut readers = Vec::new();
        let imu = names.imu.iter().map(|name| (name.as_str(), ["sensor_msgs", "Imu"], SENSOR));
        for (name, message_type, qos) in scans.chain(imu).chain(of_robot) {
            let topic = Maker { node: &mut self.node, names }.topic(name, message_type, &qos)?;
            let reader = self.context.domain_participant().create_subscriber(&(&qos).into());
            let reader = reader.and_then(|by| by.create_simple_datareader_no_key::<_, Raw>(&topic, None));
            readers.push(RawReader {
                topic: names.absolute(name),
                message_type: message_type.join("/msg/"),
                reader: reader.map_err(|error| names.failed(error))?,
            });
        }
        Ok(forward(readers, self.shared.clone(), Arc::clone(&self.publishers), names.map_frame.clone())?)
    }

    /// Where a user says that the robot is.
    pub(super) fn initial_poses(&mut self) -> Result<Subscription<PoseWithCovariance>, LiveError> {
        Maker { node: &mut self.node, names: &self.names }.subscription("initialpose", POSE)
    }

    /// Requests to save the map.
    pub(super) fn save_requests(&mut self) -> Result<Subscription<Empty>, LiveError> {
        Maker { node: &mut self.node, names: &self.names }.subscription("save_map", ["std_msgs", "Empty"])
    }

    /// What came so far.
    pub fn shared(&self) -> &Shared {
        &self.shared
    }

    /// The names that were chosen.
    pub fn names(&self) -> &Names {
        &self.names
    }

    /// The network that it is on.
    pub fn network(&self) -> Network {
        Network(self.context.clone())
    }
}

/// The others on a network.
#[derive(Clone)]
pub struct Network(Context);

impl Network {
    /// The topics that others publish, with their types.
    pub fn topics(&self) -> Vec<(String, String)> {
        let participant = self.0.domain_participant();
        let own = participant.guid().prefix;
        let writers = participant.discovered_writers().into_iter().map(|writer| writer.publication_topic_data);
        let mut topics: Vec<_> = writers
            .filter(|topic| topic.key.prefix != own)
            .filter_map(|topic| {
                let message_type = topic.type_name.replace("dds_::", "").replace("::", "/");
                Some((topic.topic_name.strip_prefix("rt")?.to_owned(), message_type.trim_end_matches('_').to_owned()))
            })
            .collect();
        topics.sort();
        topics.dedup();
        topics
    }
}
