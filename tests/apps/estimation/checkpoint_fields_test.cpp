// What a checkpoint holds comes back the same to the bit.
#include <cmath>

#include "apps/estimation/checkpoint_fields.hpp"
#include "tests/catch.hpp"

namespace orbid::tests::checkpoint_fields_test {

using estimator::ActiveSet;
using estimator::BlockLayout;
using estimator::Group;

namespace {

Group group(const std::string& name, estimator::ErrorDistribution distribution, estimator::Prior prior) {
    Group result;
    result.name = name;
    result.unit = "rad";
    result.scale = {false, 1e-4 / 3.0, prior};
    result.distribution = std::move(distribution);
    result.floor = 1e-6;
    result.ordered = true;
    result.interval = 0.1;
    return result;
}

ActiveSet made_up() {
    ActiveSet set;
    set.groups = {group("a", estimator::NormalErrors{}, estimator::FlatPrior{}),
                  group("b", estimator::StudentErrors{{true, 4.5, estimator::UniformPrior{2.0, 30.0}}},
                        estimator::GammaPrior{2.0, 0.3}),
                  group("c", estimator::RelativeErrors{{true, 0.07, estimator::StudentPrior{3.0, 0.1, 0.2}}},
                        estimator::HalfCauchyPrior{0.4}),
                  group("d", estimator::AutoregressiveErrors{}, estimator::LogNormalPrior{1.0, 0.5})};
    BlockLayout block;
    block.label = "cycle 3";
    block.group = {0, 1, 2, 3};
    block.shape = Eigen::Matrix4d::Identity() / 7.0;
    block.observed = Eigen::Vector4d(1.0, 2.0, 3.0, 1.0 / 3.0);
    block.latents = 2;
    block.next = 5;
    block.active = false;
    set.layout = {block, BlockLayout{}};
    set.latents = {Eigen::Vector2d(0.1, -0.2), Eigen::VectorXd()};
    set.is_intermediate_stage = true;
    set.memory = {Eigen::VectorXd(), Eigen::Vector3d(1e-300, -0.0, 1e300)};
    return set;
}

std::string written(ActiveSet set) {
    std::string bytes;
    apps::Archive archive(bytes);
    archive(set);
    return bytes;
}

}  // namespace

TEST_CASE("an active set goes through a checkpoint", "[apps][checkpoint]") {
    const std::string bytes = written(made_up());
    ActiveSet back;
    apps::Archive archive{std::string_view(bytes)};
    archive(back);
    CHECK(archive.at_end());
    CHECK(written(back) == bytes);
    REQUIRE(back.groups.size() == 4);
    CHECK(back.groups[0].scale.value == 1e-4 / 3.0);
    const auto& student = std::get<estimator::StudentErrors>(back.groups[1].distribution);
    CHECK(student.dof.value == 4.5);
    CHECK(std::get<estimator::UniformPrior>(student.dof.prior).upper == 30.0);
    CHECK(std::get<estimator::GammaPrior>(back.groups[1].scale.prior).rate == 0.3);
    CHECK(std::get<estimator::StudentPrior>(
              std::get<estimator::RelativeErrors>(back.groups[2].distribution).relative.prior)
              .location == 0.1);
    CHECK(std::holds_alternative<estimator::AutoregressiveErrors>(back.groups[3].distribution));
    CHECK(back.layout[0].group == std::vector<int>{0, 1, 2, 3});
    CHECK(back.layout[0].shape == made_up().layout[0].shape);
    CHECK_FALSE(back.layout[0].active);
    CHECK(back.layout[1].active);
    CHECK(back.is_intermediate_stage);
    CHECK(back.memory[0].size() == 0);
    CHECK(std::signbit(back.memory[1][1]));
}

TEST_CASE("an unknown kind of errors in a checkpoint is refused", "[apps][checkpoint]") {
    estimator::ErrorDistribution distribution = estimator::StudentErrors{};
    std::string bytes;
    apps::Archive to(bytes);
    to(distribution);
    bytes[0] = 77;
    apps::Archive archive{std::string_view(bytes)};
    CHECK_THROWS_AS(archive(distribution), apps::DamagedCheckpoint);
}

}  // namespace orbid::tests::checkpoint_fields_test
