// Two responses with one unknown full covariance: Kmenta's demand and supply equations (tests/reference/kmenta).

#include <array>
#include <cmath>
#include <tuple>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/QR>

#include "tests/estimator/estimate/reference_case.hpp"

namespace orbid::tests::kmenta_test {

namespace {

/// Several linear responses with a common full covariance, all records in one block, one response after the other.
class Responses : public FunctionResidual {
public:
    Responses(std::vector<Eigen::MatrixXd> designs, std::vector<Eigen::VectorXd> y)
        : designs_(std::move(designs)), y_(std::move(y)) {
        Eigen::Index columns = 0;
        for (const Eigen::MatrixXd& design : designs_)
            columns += design.cols();
        const Eigen::Index n = y_.front().size();
        const auto m = std::ssize(y_);
        Eigen::MatrixXd x = Eigen::MatrixXd::Zero(n * m, columns);
        Eigen::VectorXd all(n * m);
        auto block = orbid::tests::layout("years", n * m);
        Eigen::Index column = 0;
        for (std::ptrdiff_t i = 0; i < m; ++i) {
            const auto& design = designs_[static_cast<std::size_t>(i)];
            x.block(i * n, column, n, design.cols()) = design;
            column += design.cols();
            all.segment(i * n, n) = y_[static_cast<std::size_t>(i)];
            for (Eigen::Index k = 0; k < n; ++k)
                block.group[static_cast<std::size_t>(i * n + k)] = static_cast<int>(i);
            add_group(group("response " + std::to_string(i)));
            joint.groups.push_back(static_cast<int>(i));
        }
        add_block(block, linear(all, x));
    }

    [[nodiscard]] std::vector<estimator::JointCovariance> covariances() const override { return {joint}; }

    /// Errors at theta, shape (records, responses).
    [[nodiscard]] Eigen::MatrixXd errors(const Eigen::VectorXd& theta) const {
        Eigen::MatrixXd e(y_.front().size(), std::ssize(y_));
        Eigen::Index column = 0;
        for (Eigen::Index i = 0; i < e.cols(); ++i) {
            const auto& design = designs_[static_cast<std::size_t>(i)];
            e.col(i) = y_[static_cast<std::size_t>(i)] - design * theta.segment(column, design.cols());
            column += design.cols();
        }
        return e;
    }

    /// Generalised least squares under V: sum_ij V^-1_ij X_i^T X_j and its right hand side, theta and its covariance.
    [[nodiscard]] std::pair<Eigen::VectorXd, Eigen::MatrixXd> theta_given(const Eigen::MatrixXd& v) const {
        const Eigen::MatrixXd w = v.inverse();
        Eigen::Index columns = 0;
        for (const Eigen::MatrixXd& design : designs_)
            columns += design.cols();
        Eigen::MatrixXd h(columns, columns);
        Eigen::VectorXd g = Eigen::VectorXd::Zero(columns);
        Eigen::Index row = 0;
        for (std::size_t i = 0; i < designs_.size(); ++i) {
            Eigen::Index column = 0;
            for (std::size_t j = 0; j < designs_.size(); ++j) {
                const double wij = w(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
                h.block(row, column, designs_[i].cols(), designs_[j].cols()) =
                    wij * designs_[i].transpose() * designs_[j];
                g.segment(row, designs_[i].cols()) += wij * designs_[i].transpose() * y_[j];
                column += designs_[j].cols();
            }
            row += designs_[i].cols();
        }
        const Eigen::MatrixXd covariance = h.inverse();
        return {h.ldlt().solve(g), covariance};
    }

    estimator::JointCovariance joint;

private:
    std::vector<Eigen::MatrixXd> designs_;
    std::vector<Eigen::VectorXd> y_;
};

struct Kmenta {
    Eigen::VectorXd one, consump, price, income, farm_price, trend;
};

Kmenta kmenta() {
    const Eigen::MatrixXd table = reference_table("kmenta/kmenta.csv");
    REQUIRE(table.rows() == 20);
    return {Eigen::VectorXd::Ones(20), table.col(0), table.col(1), table.col(2), table.col(3), table.col(4)};
}

Eigen::MatrixXd columns(const std::vector<Eigen::VectorXd>& vectors) {
    Eigen::MatrixXd matrix(vectors.front().size(), std::ssize(vectors));
    for (std::size_t j = 0; j < vectors.size(); ++j)
        matrix.col(static_cast<Eigen::Index>(j)) = vectors[j];
    return matrix;
}

Responses demand_and_supply() {
    const Kmenta k = kmenta();
    return {{columns({k.one, k.price, k.income}), columns({k.one, k.income, k.farm_price, k.trend})},
            {k.consump, k.price}};
}

std::vector<estimator::FreeParameter> parameters(Eigen::Index count) {
    std::vector<estimator::FreeParameter> result;
    for (Eigen::Index i = 0; i < count; ++i)
        result.push_back(free_parameter("b" + std::to_string(i), 0.0));
    return result;
}

estimator::Estimate maximum_likelihood(Responses& residual, Eigen::Index count) {
    estimator::EstimateOptions options;
    options.variance = estimator::Variance::ml;
    // Steps of theta and V alternate or couple: either way 1e-12 posterior sds leave ten digits and more.
    options.step_tolerance = 1e-12;
    return estimator::estimate(parameters(count), {&residual}, {}, options);
}

}  // namespace

TEST_CASE("Kmenta's equations: maximum likelihood with a full covariance", "[estimator][reference]") {
    // 22-digit computation; agrees with R systemfit's iterated estimates where these are printed.
    constexpr std::array theta{93.619220280103667994, -0.229538090339858974, 0.310013445988652317,
                               89.268990315069720755, 0.664061865481857193,  -0.473003128132776917,
                               -0.791932105620294522};
    constexpr std::array sd{6.849945418822, 0.081568218561, 0.042317413367, 3.016467585433,
                            0.037722933973, 0.033208842546, 0.058461457685};
    constexpr std::array v{3.33710823497677122, -1.96547179439472675, 2.05879373961542298};
    Responses residual = demand_and_supply();
    const auto result = maximum_likelihood(residual, 7);
    CAPTURE(result.message, result.iterations, result.rounds);
    REQUIRE(result.status == estimator::EstimateStatus::converged);
    for (std::size_t i = 0; i < theta.size(); ++i) {
        CAPTURE(i);
        CHECK_THAT(result.parameters[i].value, WithinRel(theta[i], 1e-10));
        CHECK_THAT(result.parameters[i].sd, WithinRel(sd[i], 1e-10));
    }
    REQUIRE(result.covariances.size() == 1);
    const estimator::EstimatedCovariance& covariance = result.covariances[0];
    CHECK(covariance.groups == std::vector<std::string>{"response 0", "response 1"});
    CHECK_THAT(covariance.value(0, 0), WithinRel(v[0], 1e-10));
    CHECK_THAT(covariance.value(1, 0), WithinRel(v[1], 1e-10));
    CHECK_THAT(covariance.value(0, 1), WithinRel(v[1], 1e-10));
    CHECK_THAT(covariance.value(1, 1), WithinRel(v[2], 1e-10));
    CHECK_THAT(result.log_likelihood, WithinRel(-67.768094907706151, 1e-10));
    // Laplace in ln L_11, L_21, ln L_22 of V = L L^T, theta following its best: differences of the concentrated
    // criterion n/2 ln|V| + 1/2 tr(V^-1 M), carried to the elements of V.
    using Psi = Eigen::Vector3d;
    const auto covariance_at = [](const Psi& psi) {
        Eigen::Matrix2d lower;
        lower << std::exp(psi[0]), 0.0, psi[1], std::exp(psi[2]);
        return Eigen::Matrix2d(lower * lower.transpose());
    };
    const auto criterion = [&](const Psi& psi) {
        const Eigen::Matrix2d at = covariance_at(psi);
        const Eigen::MatrixXd e = residual.errors(residual.theta_given(at).first);
        return 10.0 * std::log(at.determinant()) + 0.5 * (at.inverse() * e.transpose() * e).trace();
    };
    const Eigen::Matrix2d lower = Eigen::Matrix2d(covariance.value).llt().matrixL();
    const Psi best(std::log(lower(0, 0)), lower(1, 0), std::log(lower(1, 1)));
    constexpr double h = 1e-3;  // truncation h^2, rounding 1e-14 * 70 / h^2: both about 1e-6
    Eigen::Matrix3d hessian;
    Eigen::Matrix<double, 4, 3> slope;
    for (int i = 0; i < 3; ++i) {
        const Psi u = h * Psi::Unit(i);
        slope.col(i) = (covariance_at(best + u) - covariance_at(best - u)).reshaped() / (2.0 * h);
        for (int j = 0; j < 3; ++j) {
            const Psi w = h * Psi::Unit(j);
            hessian(i, j) = (criterion(best + u + w) - criterion(best + u - w) - criterion(best - u + w) +
                             criterion(best - u - w)) /
                            (4.0 * h * h);
        }
    }
    const Eigen::Matrix4d of_elements = slope * hessian.inverse() * slope.transpose();
    for (Eigen::Index i = 0; i < 2; ++i)
        for (Eigen::Index j = 0; j < 2; ++j)
            CHECK_THAT(covariance.uncertainty(i, j), WithinRel(std::sqrt(of_elements(2 * j + i, 2 * j + i)), 1e-4));
}

TEST_CASE("the same regressors in every response give ordinary least squares", "[estimator][reference]") {
    const Kmenta k = kmenta();
    const Eigen::MatrixXd x = columns({k.one, k.income, k.farm_price, k.trend});
    Responses residual({x, x}, {k.consump, k.price});
    const auto result = maximum_likelihood(residual, 8);
    CAPTURE(result.message);
    REQUIRE(result.status == estimator::EstimateStatus::converged);
    Eigen::VectorXd expected(8);
    expected << x.colPivHouseholderQr().solve(k.consump), x.colPivHouseholderQr().solve(k.price);
    for (Eigen::Index i = 0; i < 8; ++i)
        CHECK_THAT(result.parameters[static_cast<std::size_t>(i)].value, WithinRel(expected[i], 1e-9));
    const Eigen::MatrixXd e = residual.errors(expected);
    const Eigen::MatrixXd v = e.transpose() * e / 20.0;
    CHECK((result.covariances[0].value - v).cwiseAbs().maxCoeff() < 1e-9 * v.cwiseAbs().maxCoeff());
}

// consump = a0 + a1 price + ... and price = b0 + b1 consump + ... over the same other columns are one plane written
// twice: with b1 = 1 / a1 the errors are proportional, |V| = 0, and the likelihood is unbounded.
TEST_CASE("responses that fit each other are refused", "[estimator][reference]") {
    const Kmenta k = kmenta();
    const auto degenerate = [&] {
        return Responses({columns({k.one, k.price, k.income}), columns({k.one, k.consump, k.income})},
                         {k.consump, k.price});
    };
    Responses residual = degenerate();
    const auto result = maximum_likelihood(residual, 6);
    CAPTURE(result.message);
    CHECK(result.status != estimator::EstimateStatus::converged);
    CHECK_THAT(result.message, ContainsSubstring("covariance"));
    // A prior of V keeps it from zero: the same responses have an estimate then.
    Responses kept = degenerate();
    kept.joint.dof = 4.0;
    kept.joint.psi = 4.0 * Eigen::Matrix2d::Identity();
    const auto with_prior = maximum_likelihood(kept, 6);
    CAPTURE(with_prior.message);
    CHECK(with_prior.status == estimator::EstimateStatus::converged);
}

TEST_CASE("an inverse-Wishart prior moves the covariance to (Psi + M) / (n + nu + m + 1)", "[estimator]") {
    Responses residual = demand_and_supply();
    residual.joint.dof = 6.0;
    residual.joint.psi.resize(2, 2);
    residual.joint.psi << 8.0, 1.0, 1.0, 5.0;
    // The fixed point of theta given V and V given theta, each in closed form.
    Eigen::MatrixXd v = Eigen::Matrix2d::Identity();
    Eigen::VectorXd theta;
    Eigen::MatrixXd covariance;
    double change = 1.0;
    for (int i = 0; i < 500 && change > 1e-14; ++i) {
        std::tie(theta, covariance) = residual.theta_given(v);
        const Eigen::MatrixXd e = residual.errors(theta);
        const Eigen::MatrixXd next = (residual.joint.psi + e.transpose() * e) / (20.0 + 6.0 + 2.0 + 1.0);
        change = (next - v).norm() / v.norm();
        v = next;
    }
    REQUIRE(change <= 1e-14);
    const auto result = maximum_likelihood(residual, 7);
    CAPTURE(result.message);
    REQUIRE(result.status == estimator::EstimateStatus::converged);
    CHECK((result.covariances[0].value - v).cwiseAbs().maxCoeff() < 1e-10 * v.cwiseAbs().maxCoeff());
    for (Eigen::Index i = 0; i < 7; ++i) {
        CHECK_THAT(result.parameters[static_cast<std::size_t>(i)].value, WithinRel(theta[i], 1e-10));
        CHECK_THAT(result.parameters[static_cast<std::size_t>(i)].sd, WithinRel(std::sqrt(covariance(i, i)), 1e-9));
    }
}

}  // namespace orbid::tests::kmenta_test
