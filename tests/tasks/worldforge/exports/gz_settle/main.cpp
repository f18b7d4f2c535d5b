// Loads a world file into gz-physics with DART, lets it run, and prints where models are.
//
//   gz_settle PLUGIN WORLD SECONDS FOLDER...
//
// FOLDERs are what model:// stands for. One line a model: "model", its name, x, y, z of its link at
// first, then at the end; and one a joint: "joint", its model, its position at the end. When SECONDS is
// negative, joints are pushed backwards at first.

#include <cmath>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include <ignition/physics/ConstructEmpty.hh>
#include <ignition/physics/ForwardStep.hh>
#include <ignition/physics/FrameSemantics.hh>
#include <ignition/physics/GetEntities.hh>
#include <ignition/physics/Joint.hh>
#include <ignition/physics/RequestEngine.hh>
#include <ignition/physics/sdf/ConstructModel.hh>
#include <ignition/physics/sdf/ConstructWorld.hh>
#include <ignition/plugin/Loader.hh>
#include <sdf/sdf.hh>

namespace physics = ignition::physics;

struct Features : physics::FeatureList<
                      physics::GetEngineInfo, physics::GetWorldFromEngine,
                      physics::GetModelFromWorld, physics::GetLinkFromModel,
                      physics::GetJointFromModel, physics::GetBasicJointState,
                      physics::SetBasicJointState, physics::LinkFrameSemantics,
                      physics::ForwardStep, physics::sdf::ConstructSdfWorld> {};

int main(int count, char **arguments) {
  if (count < 5) {
    std::cerr << "gz_settle PLUGIN WORLD SECONDS FOLDER...\n";
    return 2;
  }
  const double seconds = std::atof(arguments[3]);
  sdf::setFindCallback([&](const std::string &uri) -> std::string {
    const std::string name = uri.rfind("model://", 0) == 0 ? uri.substr(8) : uri;
    for (int index = 4; index < count; ++index) {
      const std::string path = std::string(arguments[index]) + "/" + name;
      if (sdf::filesystem::exists(path)) return path;
    }
    return "";
  });
  sdf::Root root;
  const auto errors = root.Load(arguments[2]);
  for (const auto &error : errors) std::cerr << error << "\n";
  if (!errors.empty() || root.WorldCount() != 1) return 1;

  ignition::plugin::Loader loader;
  loader.LoadLib(arguments[1]);
  auto plugin = loader.Instantiate("ignition::physics::dartsim::Plugin");
  auto engine = physics::RequestEngine3d<Features>::From(plugin);
  if (!engine) {
    std::cerr << "the plugin lacks a feature\n";
    return 1;
  }
  auto world = engine->ConstructWorld(*root.WorldByIndex(0));
  if (!world || world->GetModelCount() != root.WorldByIndex(0)->ModelCount()) {
    std::cerr << "models are missing\n";
    return 1;
  }

  std::vector<Eigen::Vector3d> before;
  for (std::size_t index = 0; index < world->GetModelCount(); ++index) {
    auto model = world->GetModel(index);
    before.push_back(model->GetLink(0)->FrameDataRelativeToWorld().pose.translation());
    if (seconds < 0)
      for (std::size_t joint = 0; joint < model->GetJointCount(); ++joint)
        if (model->GetJoint(joint)->GetName() == "joint") model->GetJoint(joint)->SetVelocity(0, -1.5);
  }
  physics::ForwardStep::Output output;
  physics::ForwardStep::State state;
  physics::ForwardStep::Input input;
  for (int step = 0; step < std::lround(1000 * std::abs(seconds)); ++step) world->Step(output, state, input);
  for (std::size_t index = 0; index < world->GetModelCount(); ++index) {
    auto model = world->GetModel(index);
    const Eigen::Vector3d after = model->GetLink(0)->FrameDataRelativeToWorld().pose.translation();
    std::cout << "model " << model->GetName();
    for (const auto &point : {before[index], after}) std::cout << " " << point.x() << " " << point.y() << " " << point.z();
    std::cout << "\n";
    for (std::size_t joint = 0; joint < model->GetJointCount(); ++joint) {
      // The others weld static models to the world.
      if (model->GetJoint(joint)->GetName() == "joint")
        std::cout << "joint " << model->GetName() << " " << model->GetJoint(joint)->GetPosition(0) << "\n";
    }
  }
  return 0;
}
