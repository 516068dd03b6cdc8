// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
//
// A rover that turns, of Project Chrono's rigid bodies on its SCM terrain. Writes means over 0.1 s.
//
//     scm_turning OUT.csv SCHEDULE [key=value ...]
//
// SCHEDULE has lines "t slope lean v yaw_rate": s, deg uphill along x of the world, deg uphill
// along its y, m/s and rad/s of the commanded twist; values between two lines are interpolated.
// wheels=4 is the rigid skid-steer of the preset four_wheel_rover, wheels=6 the rocker-bogie of the
// preset mars_rover with every wheel steered and two rockers hinged below the centre of mass.
// Frames as in REP-103. The ground is level and gravity leans, so angles are relative to gravity.

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "chrono/functions/ChFunctionConst.h"
#include "chrono/physics/ChBody.h"
#include "chrono/physics/ChLinkMate.h"
#include "chrono/physics/ChLinkMotorRotationAngle.h"
#include "chrono/physics/ChLinkMotorRotationSpeed.h"
#include "chrono/physics/ChSystemNSC.h"
#include "chrono/solver/ChDirectSolverLS.h"
#include "chrono_vehicle/terrain/SCMTerrain.h"
#include "wheel_rays.h"

using chrono::ChFrame;
using chrono::ChFunctionConst;
using chrono::ChLinkMateGeneric;
using chrono::ChLinkMotorRotationAngle;
using chrono::ChLinkMotorRotationSpeed;
using chrono::ChQuaternion;

constexpr double DEG = chrono::CH_DEG_TO_RAD;

// t, slope, lean, v, yaw rate
using Row = std::array<double, 5>;

static std::vector<Row> read_schedule(const char* path) {
    std::ifstream file(path);
    std::vector<Row> rows;
    for (std::string line; std::getline(file, line);) {
        Row row{};
        std::istringstream in(line);
        bool whole = !line.empty() && line[0] != '#';
        for (double& value : row) whole = whole && in >> value;
        if (whole) rows.push_back(row);
    }
    return rows;
}

static Row at(const std::vector<Row>& rows, double t) {
    if (t <= rows.front()[0]) return rows.front();
    for (size_t i = 1; i < rows.size(); i++)
        if (t <= rows[i][0]) {
            const double share = (t - rows[i - 1][0]) / (rows[i][0] - rows[i - 1][0]);
            Row row{};
            for (size_t k = 0; k < row.size(); k++)
                row[k] = rows[i - 1][k] + share * (rows[i][k] - rows[i - 1][k]);
            return row;
        }
    return rows.back();
}

struct Preset {
    double mass, gravity, radius, width, wheel_inertia, track;
    std::vector<double> axle_x;
    double centre_height, pivot_x, pivot_height;
    bool steered;  // on a rocker-bogie; else the wheels are on one rigid body
};

static const Preset FOUR_WHEELS{50,   9.81, 0.165, 0.12, 0.04, 0.57, {0.255, -0.255},
                                0.25, 0.0,  0.0,   false};
static const Preset SIX_WHEELS{185,  3.72,  0.13, 0.16, 0.02, 1.0, {0.7, 0.0, -0.7},
                               0.45, -0.35, 0.30, true};

using Options = std::map<std::string, double>;

struct Wheel {
    std::string name;
    double x, y;
    std::shared_ptr<ChBody> body, carrier;  // the carrier does not turn with the wheel
    std::shared_ptr<ChLinkMotorRotationSpeed> motor;
    std::shared_ptr<ChFunctionConst> rate, angle;
};

// The rover on its terrain. Rockers and bogies are left and right; without a bogie both rockers are
// the one body.
class Plant {
  public:
    Plant(const Preset& preset, const Options& with)
        : m_preset(preset), m_rays(std::make_shared<WheelRays>()) {
        m_system.SetNumThreads(1, 1, 1);
        m_system.SetCollisionSystem(m_rays);
        m_system.SetSolver(std::make_shared<chrono::ChSolverSparseLU>());
        m_system.SetTimestepperType(chrono::ChTimestepper::Type::EULER_IMPLICIT_LINEARIZED);
        m_terrain = std::make_unique<chrono::vehicle::SCMTerrain>(&m_system, false);
        add_chassis();
        // The grid crosses the wheels askew, so that no row of nodes enters at once.
        m_terrain->SetReferenceFrame(
            chrono::ChCoordsys<>(chrono::VNULL, chrono::QuatFromAngleZ(31.7 * DEG)));
        m_terrain->SetSoilParameters(with.at("k_phi"), with.at("k_c"), with.at("n"), with.at("c"),
                                     with.at("phi_deg"), with.at("K"), with.at("elastic"),
                                     with.at("damping"));
        for (size_t axle = 0; axle < preset.axle_x.size(); axle++)
            for (int side = 0; side < 2; side++) add_wheel(axle, side);
        m_terrain->Initialize(2, 2, with.at("node"));
    }

    double time() const { return m_system.GetChTime(); }
    const std::vector<Wheel>& wheels() const { return m_wheels; }
    const Preset& preset() const { return m_preset; }
    ChVector3d x_axis() const {
        return (m_rocker[0]->GetRot().GetAxisX() + m_rocker[1]->GetRot().GetAxisX())
            .GetNormalized();
    }
    ChVector3d y_axis() const {
        return (m_rocker[0]->GetRot().GetAxisY() + m_rocker[1]->GetRot().GetAxisY())
            .GetNormalized();
    }
    ChVector3d velocity() const {
        return 0.5 * (m_rocker[0]->GetPosDt() + m_rocker[1]->GetPosDt());
    }
    double yaw_rate() const {
        return 0.5 * (m_rocker[0]->GetAngVelLocal().z() + m_rocker[1]->GetAngVelLocal().z());
    }
    ChVector3d place() const { return m_rocker[0]->GetPos(); }
    ChVector3d gravity() const { return m_system.GetGravitationalAcceleration(); }

    // Angle of a bogie to the body, nose up.
    double bogie_angle(int side) const {
        if (!m_preset.steered) return 0;
        return std::asin(m_bogie[side]->GetRot().GetAxisX().z()) - std::asin(x_axis().z());
    }

    // Gravity leans by these angles [deg] uphill along x and along y of the world.
    void lean(double slope, double across) {
        const double up = std::sin(slope * DEG), beside = std::sin(across * DEG);
        m_system.SetGravitationalAcceleration(
            ChVector3d(-up, -beside, -std::sqrt(1 - up * up - beside * beside)) * m_preset.gravity);
    }

    // Wheel rates and steering angles of wheels that roll with this twist, no wheel by more than a
    // right angle. A steering drive follows within 0.3 s.
    void command(double v, double yaw_rate, double dt) {
        for (auto& wheel : m_wheels) {
            double speed = v - yaw_rate * wheel.y;
            if (m_preset.steered) {
                const double left = yaw_rate * wheel.x, kept = std::exp(-dt / 0.3);
                double angle = std::atan2(left, speed);
                speed = std::hypot(speed, left);
                if (std::abs(angle) > chrono::CH_PI_2 + 1e-9) {
                    angle -= std::copysign(chrono::CH_PI, angle);
                    speed = -speed;
                }
                if (std::abs(speed) < 1e-9) angle = wheel.angle->GetConstant();
                wheel.angle->SetConstant(kept * wheel.angle->GetConstant() + (1 - kept) * angle);
            }
            wheel.rate->SetConstant(speed / m_preset.radius);
        }
    }

    void step(double dt) { m_system.DoStepDynamics(dt); }

    // Force and moment of the ground on a wheel; false where it touches none.
    bool ground(const Wheel& wheel, ChVector3d& force, ChVector3d& torque) {
        return m_terrain->GetContactForceBody(wheel.body, force, torque);
    }

    // Mean height of the ground just ahead of a wheel that moves along `heading`, over its width.
    double height_ahead(const Wheel& wheel, const ChVector3d& heading, double speed) const {
        const ChVector3d ahead = heading * std::copysign(0.14 / 0.13 * m_preset.radius, speed);
        const ChVector3d aside = ChVector3d(-heading.y(), heading.x(), 0);
        double sum = 0;
        for (int k = -2; k <= 2; k++)
            sum += m_terrain->GetHeight(wheel.body->GetPos() + ahead +
                                        aside * (0.2 * k * m_preset.width));
        return sum / 5;
    }

  private:
    std::shared_ptr<ChBody> add(double mass, const ChVector3d& inertia, const ChVector3d& place) {
        auto body = std::make_shared<ChBody>();
        body->SetMass(mass);
        body->SetInertiaXX(inertia);
        body->SetPos(place);
        body->EnableCollision(false);
        m_system.AddBody(body);
        return body;
    }

    void hinge(std::shared_ptr<ChBody> one, std::shared_ptr<ChBody> other,
               const ChVector3d& place) {
        auto joint = std::make_shared<ChLinkMateGeneric>(true, true, true, true, true, false);
        joint->Initialize(one, other, ChFrame<>(place, ACROSS));
        m_system.AddLink(joint);
    }

    double side_y(int side) const { return (side == 0 ? 0.5 : -0.5) * m_preset.track; }
    double wheel_mass() const {
        return m_preset.wheel_inertia / (0.5 * m_preset.radius * m_preset.radius);
    }

    // What is neither wheel, knuckle nor bogie has the mass and place that give the whole its own.
    void add_chassis() {
        const Preset& p = m_preset;
        const double bogies = p.steered ? 2 * BOGIE_MASS : 0.0;
        const double hubs = 2 * p.axle_x.size() * (wheel_mass() + (p.steered ? KNUCKLE_MASS : 0.0));
        const double mass = p.mass - hubs - bogies, length = p.axle_x.front() - p.axle_x.back();
        const ChVector3d place(
            -bogies * p.pivot_x / mass, 0,
            (p.mass * p.centre_height - hubs * p.radius - bogies * p.pivot_height) / mass);
        const ChVector3d inertia(mass * p.track * p.track / 12, mass * length * length / 12,
                                 mass * (p.track * p.track + length * length) / 12);
        if (!p.steered) {
            m_rocker[0] = m_rocker[1] = add(mass, inertia, place);
            return;
        }
        for (int side = 0; side < 2; side++) {
            const ChVector3d pivot(p.pivot_x, side_y(side), p.pivot_height);
            m_rocker[side] = add(0.5 * mass, inertia * 0.5, place);
            m_bogie[side] = add(BOGIE_MASS, ChVector3d(0.02, 0.1, 0.1), pivot);
            hinge(m_bogie[side], m_rocker[side], pivot);
        }
        hinge(m_rocker[0], m_rocker[1], ChVector3d(0, 0, p.pivot_height));
    }

    void add_wheel(size_t axle, int side) {
        static const char* const names[] = {"front", "middle", "rear"};
        const size_t name = axle + 1 == m_preset.axle_x.size() ? 2 : axle;
        const double r = m_preset.radius;
        Wheel wheel;
        wheel.name = std::string(names[name]) + (side == 0 ? "_left" : "_right");
        wheel.x = m_preset.axle_x[axle];
        wheel.y = side_y(side);
        wheel.rate = std::make_shared<ChFunctionConst>(0.0);
        wheel.angle = std::make_shared<ChFunctionConst>(0.0);
        wheel.carrier = m_preset.steered && axle > 0 ? m_bogie[side] : m_rocker[side];
        const ChVector3d place(wheel.x, wheel.y, r);
        if (m_preset.steered) {
            auto knuckle = add(KNUCKLE_MASS, ChVector3d(0.01, 0.01, 0.01), place);
            auto steering = std::make_shared<ChLinkMotorRotationAngle>();
            steering->Initialize(knuckle, wheel.carrier, ChFrame<>(place));
            steering->SetAngleFunction(wheel.angle);
            m_system.AddLink(steering);
            wheel.carrier = knuckle;
        }
        wheel.body = add(wheel_mass(), ChVector3d(0.6, 1, 0.6) * m_preset.wheel_inertia, place);
        auto model = std::make_shared<chrono::ChCollisionModel>();
        wheel.body->AddCollisionModel(model);
        m_rays->add(wheel.body, model, r, m_preset.width);
        wheel.motor = std::make_shared<ChLinkMotorRotationSpeed>();
        wheel.motor->Initialize(wheel.body, wheel.carrier, ChFrame<>(place, ACROSS));
        wheel.motor->SetSpeedFunction(wheel.rate);
        m_system.AddLink(wheel.motor);
        m_terrain->AddActiveDomain(wheel.carrier, place - wheel.carrier->GetPos(),
                                   ChVector3d(1.8 * r, m_preset.width + 0.02, 2.1 * r));
        m_wheels.push_back(wheel);
    }

    static constexpr double KNUCKLE_MASS = 0.5, BOGIE_MASS = 2.0;
    // A link's z is y of the world.
    const ChQuaternion<> ACROSS = chrono::QuatFromAngleX(-chrono::CH_PI_2);

    const Preset& m_preset;
    chrono::ChSystemNSC m_system;
    std::shared_ptr<WheelRays> m_rays;
    std::unique_ptr<chrono::vehicle::SCMTerrain> m_terrain;  // needs a collision system
    std::array<std::shared_ptr<ChBody>, 2> m_rocker, m_bogie;
    std::vector<Wheel> m_wheels;
};

// Sums over the steps of a sample, and its line in the file.
class Means {
  public:
    Means(FILE* out, const Plant& plant) : m_out(out), m_wheels(plant.wheels().size()) {
        std::fprintf(out,
                     "time,velocity,lateral_velocity,yaw_rate,pitch,roll,acceleration,"
                     "bogie_left,bogie_right");
        for (const auto& wheel : plant.wheels())
            for (const char* what : {"slip", "rate", "steering", "sinkage", "sinkage_rut",
                                     "contact", "torque", "load", "drawbar", "moment", "side"})
                std::fprintf(out, ",%s_%s", wheel.name.c_str(), what);
        std::fprintf(out, ",x,y,yaw\n");
    }

    void add(Plant& plant) {
        const ChVector3d x = plant.x_axis(), y = plant.y_axis(), velocity = plant.velocity();
        const ChVector3d down = plant.gravity() * (1 / plant.preset().gravity);
        if (m_steps++ == 0 && !m_begun) m_velocity_before = velocity, m_begun = true;
        m_body[V] += Vdot(velocity, x), m_body[VY] += Vdot(velocity, y);
        m_body[TURN] += plant.yaw_rate();
        m_body[PITCH] += std::asin(-Vdot(x, down)), m_body[ROLL] += std::asin(-Vdot(y, down));
        m_body[PULL] += -Vdot(plant.gravity(), x);
        m_body[LEFT] += plant.bogie_angle(0), m_body[RIGHT] += plant.bogie_angle(1);
        for (size_t i = 0; i < m_wheels.size(); i++) {
            const Wheel& wheel = plant.wheels()[i];
            auto& sum = m_wheels[i];
            const double angle = wheel.angle->GetConstant();
            const ChVector3d heading = x * std::cos(angle) + y * std::sin(angle);
            const ChVector3d flat = ChVector3d(heading.x(), heading.y(), 0).GetNormalized();
            sum[RATE] += wheel.motor->GetMotorAngleDt();
            sum[HUB] += Vdot(wheel.body->GetPosDt(), flat);
            sum[STEER] += angle;
            sum[CONTACT] += -std::asin(heading.z());
            sum[TORQUE] += wheel.motor->GetMotorTorque();
            ChVector3d force, torque;
            if (!plant.ground(wheel, force, torque)) continue;
            sum[LOAD] += force.z(), sum[DRAWBAR] += Vdot(force, flat);
            sum[SIDE] += flat.x() * force.y() - flat.y() * force.x();
            sum[MOMENT] += Vdot(torque, wheel.body->GetRot().GetAxisY());
        }
    }

    // Sinkages are those at the end of the sample.
    void write(const Plant& plant, double time, double dt) {
        const double n = m_steps, r = plant.preset().radius;
        const ChVector3d x = plant.x_axis(), y = plant.y_axis(), place = plant.place();
        const double specific =
            Vdot(plant.velocity() - m_velocity_before, x) / (n * dt) + m_body[PULL] / n;
        std::fprintf(m_out, "%.3f,%.7f,%.7f,%.7f,%.7f,%.7f,%.7f,%.7f,%.7f", time, m_body[V] / n,
                     m_body[VY] / n, m_body[TURN] / n, m_body[PITCH] / n, m_body[ROLL] / n,
                     specific, m_body[LEFT] / n, m_body[RIGHT] / n);
        for (size_t i = 0; i < m_wheels.size(); i++) {
            const Wheel& wheel = plant.wheels()[i];
            const auto& sum = m_wheels[i];
            const double rate = sum[RATE] / n, hub = sum[HUB] / n, angle = sum[STEER] / n;
            const ChVector3d heading = x * std::cos(angle) + y * std::sin(angle);
            const double lowest = wheel.body->GetPos().z() - r;
            std::fprintf(m_out, ",%.6f,%.6f,%.6f,%.7f,%.7f,%.7f,%.5f,%.4f,%.4f,%.5f,%.4f",
                         1 - hub / (r * rate), rate, angle, -lowest,
                         plant.height_ahead(wheel, heading, hub) - lowest, sum[CONTACT] / n,
                         sum[TORQUE] / n, sum[LOAD] / n, sum[DRAWBAR] / n, sum[MOMENT] / n,
                         sum[SIDE] / n);
        }
        std::fprintf(m_out, ",%.4f,%.4f,%.5f\n", place.x(), place.y(), std::atan2(x.y(), x.x()));
    }

    void begin(const Plant& plant) {
        m_velocity_before = plant.velocity();
        m_steps = 0;
        m_body.fill(0);
        for (auto& sum : m_wheels) sum.fill(0);
    }

  private:
    enum { V, VY, TURN, PITCH, ROLL, PULL, LEFT, RIGHT, OF_BODY };
    enum { RATE, HUB, STEER, CONTACT, TORQUE, LOAD, DRAWBAR, MOMENT, SIDE, OF_WHEEL };
    FILE* m_out;
    int m_steps = 0;
    bool m_begun = false;
    ChVector3d m_velocity_before;
    std::array<double, OF_BODY> m_body{};
    std::vector<std::array<double, OF_WHEEL>> m_wheels;
};

static bool read_options(int argc, char** argv, Options& with) {
    for (int i = 3; i < argc; i++) {
        const std::string word = argv[i];
        const auto equals = word.find('=');
        if (equals == std::string::npos || !with.count(word.substr(0, equals))) {
            std::fprintf(stderr, "unknown %s\n", argv[i]);
            return false;
        }
        with[word.substr(0, equals)] = std::atof(word.c_str() + equals + 1);
    }
    return true;
}

int main(int argc, char** argv) {
    if (argc < 3) {
        std::fprintf(stderr, "scm_turning OUT.csv SCHEDULE [key=value ...]\n");
        return 2;
    }
    Options with = {{"wheels", 4},    {"c", 800},       {"phi_deg", 31}, {"k_phi", 1523400},
                    {"k_c", 900},     {"n", 1.1},       {"K", 0.025},    {"elastic", 5e7},
                    {"damping", 1e4}, {"node", 0.0125}, {"dt", 0.0025},  {"seconds", 60},
                    {"before", 5}};
    if (!read_options(argc, argv, with)) return 2;
    const auto rows = read_schedule(argv[2]);
    if (rows.empty()) {
        std::fprintf(stderr, "%s: no line \"t slope lean v yaw_rate\"\n", argv[2]);
        return 2;
    }
    FILE* out = std::fopen(argv[1], "w");
    if (!out) {
        std::fprintf(stderr, "%s cannot be written\n", argv[1]);
        return 2;
    }
    Plant plant(with["wheels"] == 6 ? SIX_WHEELS : FOUR_WHEELS, with);
    Means means(out, plant);
    const double dt = with["dt"], settle = 0.5, start = settle + with["before"];
    const long steps_a_sample = std::lround(0.1 / dt);
    for (long step = 1; plant.time() < start + with["seconds"] - 1e-9; step++) {
        // Before the first row it stands, then drives straight up to the first command.
        const double t = plant.time(), share = t < settle ? 0.0 : std::min(1.0, t - settle);
        const double late = std::min(1.0, std::max(0.0, (t - start + 2) / 2));
        const auto [at_time, slope, across, v, yaw_rate] = at(rows, t - start);
        plant.lean(slope * late, across * late);
        plant.command(v * share, yaw_rate * (share * late), dt);
        plant.step(dt);
        means.add(plant);
        if (step % steps_a_sample) continue;
        const double time = plant.time() - start;
        if (time > 0.05) means.write(plant, time, dt);
        means.begin(plant);
        if (!std::isfinite(plant.place().z()) || plant.place().z() < 0.1) {
            std::fprintf(stderr, "fell at %g s\n", plant.time());
            break;
        }
    }
    std::fclose(out);
    return 0;
}
