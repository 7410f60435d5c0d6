"""The correction in words and formulas, for a reader who has only the JSON file."""

FORMULA = {
    "purpose": (
        "q_m = correct(q): command q_m, and the calibrated robot's tool goes where the nominal "
        "robot's would be at q, or nearer to it than at q"
    ),
    "units": (
        "m and rad; rad_or_m: in the unit of that joint; indices j count from 1, "
        "virtual_joint_columns from 0"
    ),
    "twist": "(v, w): three linear elements first, then three angular ones",
    "pose": (
        "4x4 homogeneous matrix T_a_b = [[R, p], [0, 1]], row by row: pose of frame b in frame a"
    ),
    "frames": (
        "K_0 is the robot's base, K_{n+1} its tool; placement M_j is the pose of joint frame j in "
        "joint frame j - 1 with joint j at zero, M_{n+1} that of the tool; twist xi_j of joint j "
        "is written in its own frame"
    ),
    "exp6": (
        "exp6((v, w)) = matrix exponential of [[S(w), v], [0, 0]], S(w) b = w x b; log3(R) is the "
        "rotation vector w of R = exp(S(w)), |w| <= pi"
    ),
    "adjoint": "Ad(T) = [[R, S(p) R], [0, R]]: twists of frame b to frame a for T = T_a_b",
    "network": (
        "N(q) = output_scale * (W2 tanh(W1 s + b1) + b2), s = (q - input_centre) / input_scale, "
        "element by element; W1, b1 = hidden_weights, hidden_bias; W2, b2 = output_weights, "
        "output_bias; p elements: the n actuated joints, then the virtual ones; N(q) = 0 if "
        "network is null (Eq. 16)"
    ),
    "gaussian_process": (
        "if network.kind is 'gaussian-process': N(q) = output_scale * W k, W = output_weights, "
        "k_i = exp(-|s - points_i|^2 / 2), s as above"
    ),
    "payload": (
        "a payload turns the frame before joint j by payload_rad_per_nm[j][1] n_j "
        "about its origin, in front of exp6(placement_errors): n_j is the moment of payload_kg g "
        "at the origin of T_nominal(q) about that of F0_j, the product up to M_j of the "
        "nominal robot at q, written in F0_j without its part along w_j; joint j moves by "
        "payload_rad_per_nm[j][0] times that part more"
    ),
    "bending": (
        "the links' weight turns the same frame further, about u_j by bending_rad_per_nm[j][0] "
        "and about v_j "
        "by [j][1] times its moment about that vector: the moment about the origin of F0_j of "
        "link_masses_kg[i] g at c_i, i = j..n, of the nominal robot at q (see torque); u_j, v_j = "
        "across_axes[j], in F0_j"
    ),
    "wobble": (
        "and about u_j by wobble_rad[j][0] sin q_j + wobble_rad[j][1] cos q_j, about v_j by "
        "[j][2] sin "
        "q_j + [j][3] cos q_j; the rotation vectors of payload, bending and wobble are added, "
        "and the frame "
        "turns by exp of the sum"
    ),
    "growth": (
        "the translation of nominal_placements_m[j] is 1 + expansion_per_k[j] warmth_k "
        "times as long, in placements_m and in front of the payload's turn"
    ),
    "joint_coupling": (
        "q of the serial chain = joint_coupling times the joint values that the controller shows, "
        "rad or m"
    ),
    "joint_values": (
        "'serial': q and q_m are those of the serial chain; 'controller': they are what the "
        "controller shows: everything below is for joint_coupling q, and q_m = q + "
        "inverse(joint_coupling) times the change of the serial joints"
    ),
    "nominal": (
        "T_nominal(q) = M_1 exp6(xi_1 q_1) ... M_n exp6(xi_n q_n) M_{n+1}, M = "
        "nominal_placements_m, xi = nominal_twists_per_rad_or_m (Eq. 7)"
    ),
    "base": (
        "T_base(q): the same product with M = placements_m = M_j exp6(placement_errors_m_rad_j), "
        "xi = nominal_twists_per_rad_or_m + twist_errors_per_rad_or_m, and q + "
        "offset_errors_rad_or_m + m(q) for q (Eq. 8)"
    ),
    "joint_motion": (
        "m_j(q) = sum over h = 1, 2, ... of harmonics_rad[j][2h - 2] sin(h q_j) + "
        "harmonics_rad[j][2h - 1] cos(h q_j), plus, unless pairs_rad[j] is empty, the sum over "
        "pairs k < l of joints, number i = 0, 1, ... in the order (1, 2), (1, 3) ... (n - 1, n): "
        "pairs_rad[j][4i] sin(q_k + q_l) + [4i + 1] cos(q_k + q_l) + [4i + 2] sin(q_k - q_l) + "
        "[4i + 3] cos(q_k - q_l), minus compliance_rad_per_nm[j] tau_j(q)"
    ),
    "backlash": (
        "q_m is for the middle of the backlash; for rows in the order of motion add "
        "backlash_rad_or_m[j] d_j to its joint j, d_j = -1, 0, +1 the direction of the joint's "
        "last motion, 0 if unknown"
    ),
    "torque": (
        "tau_j(q) = - sum over links i = j..n of link_masses_kg[i] g . (v_j + w_j x c_i), g = "
        "gravity_m_per_s2, (v_j, w_j) = Ad(F_j) xi_j and c_i = F_i centres_of_mass_m[i] of the "
        "nominal robot at q"
    ),
    "jacobian": (
        "J_rho, 6 x p: column j = 1..n is Ad(F_j) xi_j, xi_j and F_j those of the base, F_j the "
        "product up to and with the exponential of joint j; then, of Ad(T_base(q)), each of "
        "virtual_joint_columns (Eq. 14)"
    ),
    "calibrated": "T_calibrated(q) = exp6(J_rho N(q)) T_base(q)",
    "input": (
        "where an element of q is not finite, or beyond largest_position_rad_or_m: q_m = q, "
        "status not-finite, nothing else"
    ),
    "error": (
        "of joints x: e(x) = ((p - p_c) / characteristic_length_m, log3(R R_c')), (R, p) = "
        "T_calibrated(x), (R_c, p_c) = T_nominal(q); e = e(q)"
    ),
    "weighted_jacobian": (
        "J, 6 x n: of the first n columns (v, w) of J_rho at q, ((v + w x p) / "
        "characteristic_length_m, w), p the position in T_calibrated(q)"
    ),
    "task": (
        "n < 6: J_A and e_A are the n rows of (R_c' v, R_c' w), (v, w) the columns of J and e, "
        "that are not in virtual_joint_columns; n >= 6: J and e themselves"
    ),
    "box": (
        "joint j may change by lower_j = max(-B_j, min(0, lower limit - q_j)) to upper_j = "
        "min(B_j, max(0, upper limit - q_j)), B = largest_change_rad_or_m; by -B_j to B_j where "
        "q_j is outside its limits by more than 1e-9"
    ),
    "damping": (
        "of a matrix A with columns of the joints: G = A A' for n >= 6, A' A for n < 6, plus "
        "gram_regularisation I; d = 1 / sqrt(trace(inverse(G))), how far A is from a singularity; "
        "L = max(0, damped_below - d)^2"
    ),
    "bounded_step": (
        "of A and a: (1) S(a) = -A' inverse(G + L I) a for n >= 6, -inverse(G + L I) A' a for n < "
        "6; D = S(a), and where L > 0 D = S(a) + S(a + A S(a)). (2) Three times, if a joint is "
        "outside the box: the one that is farthest outside (in rad or m, the first of equals) is "
        "held from now on, H_j = D_j moved into the box, the others have H_j = 0; F is A with the "
        "columns of held joints set to zero (n < 6: 1 is added to their elements on the diagonal "
        "of G); L is the larger of the one before and that of F; D = H + (1) with F for A and a "
        "+ A H for a. (3) D is moved into the box element by element"
    ),
    "step": (
        "n >= 6: D = bounded_step(J, e). n < 6: D = D_J + u (D_A - D_J), D_A = bounded_step(J_A, "
        "e_A), D_J = bounded_step(J, e); c = |J (D_A - D_J)|^2, b = 0.75 max(0, |e|^2 - |e + J "
        "D_J|^2), u = sqrt(b / c) where c > b, else 1. base_model.name 'nominal': (1) of "
        "bounded_step(J_A, e_A) is replaced by D = -(the first n elements of N(q)) (Eq. 23)"
    ),
    "judgement": (
        "twice, for |e|^2 and (n < 6) for |e_A|^2: s the square at q, g = 2 e . (J D) its slope, "
        "h = that at q + D minus s and g; r = 1 where 2 h <= -g, otherwise -g / (2 h) for g < 0 "
        "and 0 for g >= 0. t = min(1, 1.5 times the smaller r)"
    ),
    "correction": (
        "q_m = q + t D where both squares are smaller at q + t D than at q, else q_m = q "
        "(dropped) (Eq. 24)"
    ),
    "status": (
        "the first that is true; more: |e(q_m)| or |e_A(q_m)| is larger than usual_error_rad. "
        "uncorrected: dropped, and more. out-of-limits: q_m is outside the joint limits by more "
        "than 1e-9. near-singular: d of J_A (n >= 6: of J) is below damped_below. out-of-limits: "
        "more, and a joint stopped at a limit. limited: more, and a joint stopped at the largest "
        "change. partial: more. ok. A joint stopped where D_j <= lower_j or D_j >= upper_j: at the "
        "largest change if |D_j| >= B_j, else at a limit"
    ),
}
